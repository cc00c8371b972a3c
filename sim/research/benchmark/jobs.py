"""The job for a worker: one method in one world with one seed, described only by names and values."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.methods import METHODS, make_method
from sim.lab.world import World
from sim.research.benchmark.sessions import (
    Commands,
    Conditions,
    Judged,
    choose_oracle,
    judge,
    mean_of,
    run_session,
    shown,
    udr_policies,
)
from sim.research.benchmark.tables import WorldTable, world_digest
from sim.research.benchmark.trial_sources import SimulatedTrials, Tabled, TrialSource
from sim.tasks import get_task

UDR, ORACLE, BEST_ACTION = "udr", "oracle", "best-action"
LIMITS = (ORACLE, BEST_ACTION)
"""Upper bounds with knowledge that no method has: the best E, or the best action, in the world."""

COMPARED = (*METHODS, *LIMITS)

WITHOUT_SIMULATION = ("learn-in-target",)
LEARNT_FROM_EPISODES = ("adaptsim-iteration", "adaptsim-state", "adaptsim-history")


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that determines a result; it can be sent to another machine with the same checkpoints."""

    task: str
    checkpoint: str  # name or folder
    set: str
    world: World
    table: WorldTable | None  # None: the world is simulated
    method: str
    seed: int
    conditions: Conditions

    @property
    def target(self) -> str:
        """The world's name."""
        return self.world.name

    @property
    def answers(self) -> str:
        """Digest of the world's answers: of its table, or of the inputs of its simulation."""
        return world_digest(get_task(self.task), self.world) if self.table is None else self.table.digest


@dataclass(frozen=True)
class Row:
    """The reward of a session's final policy, and of its best policy after each iteration."""

    task: str
    set: str
    target: str
    method: str
    seed: int
    reward: float
    ci95: tuple[float, float]
    real_trials: int
    simulations: int  # true rollouts of Phase 1 that the method needs
    wall_s: float
    curve: tuple[tuple[int, float], ...]  # (real trials, reward) after each iteration
    shown: float | None  # only UDR and oracle: the reward in other trials, which select the worlds with a gap


def run_job(job: Job, trials: TrialSource | None = None) -> Row:
    """Run the session and judge it, in this process. `trials` replaces the place in which its trials happen.

    With `Conditions.fresh`, the trials and the final score are true rollouts, but the curve comes from the table.
    Raises SimError.
    """
    began, checkpoint = time.perf_counter(), _loaded(job.task, job.checkpoint)
    solver, conditions = checkpoint.solver, job.conditions
    task, seen = solver.task, None
    simulated = SimulatedTrials(solver, job.world)
    place: TrialSource = simulated if job.table is None else Tabled(task, job.table)
    each = conditions.particles * task.adaptation.trials_per_iteration

    def final(act: Commands, policies: int = 1) -> Judged:
        """Judge by fresh rollouts, divided among `policies`, if they are requested."""
        if not conditions.fresh:
            return judge(task, act, place, conditions, job.seed)
        few = replace(conditions, judged=max(2, conditions.fresh // policies))
        return judge(task, act, simulated, few, job.seed)

    if job.method == UDR:
        policies = udr_policies(solver, job.seed)
        several = [final(policy.actions, len(policies)) for policy in policies]
        last = mean_of(several)
        seen = sum(shown(task, p.actions, place, conditions.judged, job.seed) for p in policies) / len(policies)
        return _row(job, checkpoint, last, [last], 0, began, seen)
    if job.method in LIMITS:
        act: Commands = place.best_actions
        if job.method == ORACLE:
            best, seen = choose_oracle(solver, place, conditions, job.seed)
            act = best.actions
        last = final(act)
        return _row(job, checkpoint, last, [last], 0, began, seen)
    method = make_method(job.method, task, checkpoint)
    lived = trials or (simulated if conditions.fresh else place)
    chosen = run_session(solver, method, lived, conditions, job.seed)
    curve = [judge(task, policy.actions, place, conditions, job.seed) for policy in chosen]
    return _row(job, checkpoint, final(chosen[-1].actions), curve, each, began, None)


def _row(
    job: Job, checkpoint: Checkpoint, last: Judged, curve: Sequence[Judged], each: int, began: float, seen: float | None
) -> Row:
    return Row(
        task=job.task,
        set=job.set,
        target=job.world.name,
        method=job.method,
        seed=job.seed,
        reward=last.reward,
        ci95=last.ci95,
        real_trials=each * len(curve),
        simulations=simulations(job.method, checkpoint),
        wall_s=time.perf_counter() - began,
        curve=tuple((each * (k + 1), judged.reward) for k, judged in enumerate(curve)),
        shown=seen,
    )


def simulations(method: str, checkpoint: Checkpoint) -> int:
    """True rollouts of Phase 1 that a method needs."""
    if method in WITHOUT_SIMULATION:
        return 0
    if method in LEARNT_FROM_EPISODES or checkpoint.emulator is None:
        return checkpoint.card.simulations if method in LEARNT_FROM_EPISODES else 0
    budget = checkpoint.card.budget
    return budget.rollouts + budget.denser


@lru_cache(maxsize=8)
def _loaded(task: str, checkpoint: str) -> Checkpoint:
    return load_checkpoint(get_task(task), checkpoint)
