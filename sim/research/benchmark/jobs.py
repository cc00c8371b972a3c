"""A job of a benchmark: one method in one place with one seed. Names and values describe it, so that a worker can run
it.

With recorded trials, sessions take one part of them, and scores come from the part held out. A control runs the default
method on trials whose outcomes are shuffled. Nothing can be gained there, so `permuted` must earn as much as
`permuted-udr`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.judging import final_policy
from sim.adaptation.methods import kind_of, make_method
from sim.lab.world import World
from sim.research.benchmark.entries import (
    BEST_ACTION,
    FIXED_RULES,
    LIMITS,
    ORACLE,
    UDR,
    Entry,
    fixed_policies,
    make_entry,
)
from sim.research.benchmark.knowledge import checkpoint_knowing
from sim.research.benchmark.sessions import (
    Commands,
    Conditions,
    choose_oracle,
    estimated_reward,
    mean_of,
    mean_played_reward,
    run_iterations,
    run_session,
    udr_policies,
)
from sim.research.benchmark.tables import WorldTable
from sim.research.benchmark.trial_sources import FromRecordings, SimulatedTrials, TableTrials, TrialSource
from sim.rollouts.recorded import RecordedTrials
from sim.solvers.candidates import with_listed_actions
from sim.solvers.grid import grid_behind
from sim.types import Estimate

DEFAULT = "adaptsim"
PERMUTED, PERMUTED_UDR = "permuted", "permuted-udr"
CONTROLS = (PERMUTED, PERMUTED_UDR)
"""Controls of the default method and of UDR, with the outcomes of recorded trials shuffled."""


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that determines a result; it can be sent to another machine with the same checkpoints."""

    task: str
    checkpoint: str  # name or folder
    set: str
    target: str  # name of the world, or of the folder of recorded trials
    answers: str  # digest of the world's answers, or of the trials
    method: str  # an entry's name, see `sim.research.benchmark.entries`
    seed: int
    conditions: Conditions
    world: World | None = None  # None: trials are recorded
    table: WorldTable | None = None  # None: the world is simulated
    recorded: RecordedTrials | None = None
    held_out: float = 0.0  # share of the recorded trials
    own_object: str = ""  # file of the object that the checkpoint was made for; empty: the task itself


@dataclass(frozen=True)
class BenchmarkRow:
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
    shown: float | None  # only fixed rules and oracle: the reward in other trials, which tell worlds apart


def run_job(job: Job, trials: TrialSource | None = None) -> BenchmarkRow:
    """Run the session and judge it, in this process. `trials` replaces the place in which its trials happen.

    With `Conditions.fresh`, the trials and the final score are true rollouts, but the curve comes from the table.
    Raises SimError.
    """
    if job.recorded is not None:
        return _run_recorded(job, job.recorded)
    assert job.world is not None, "a job has a world or recorded trials"
    began, entry = time.perf_counter(), Entry.parse(job.method)
    checkpoint = checkpoint_knowing(
        job.task, job.checkpoint, entry.ranges, own_object=job.own_object, tabulated=entry.needs_reward_table
    )
    solver, conditions = checkpoint.solver, job.conditions
    task, shown_reward = solver.task, None
    simulated = SimulatedTrials(solver, job.world)
    place: TrialSource = simulated if job.table is None else TableTrials(task, job.table)

    def final(act: Commands, policies: int = 1) -> Estimate:
        """Judge by fresh rollouts, divided among `policies`, if they are requested."""
        if not conditions.fresh:
            return estimated_reward(task, act, place, conditions, job.seed)
        few = replace(conditions, judged=max(2, conditions.fresh // policies))
        return estimated_reward(task, act, simulated, few, job.seed)

    if entry.name in FIXED_RULES:
        policies = fixed_policies(entry.name, checkpoint, job.seed)
        last = mean_of([final(policy.actions, len(policies)) for policy in policies])
        played = [mean_played_reward(task, p.actions, place, conditions.judged, job.seed) for p in policies]
        shown_reward = sum(played) / len(policies)
        return _row(job, checkpoint, last, None, began, shown_reward)
    if entry.name in LIMITS:
        act: Commands = place.best_actions
        if entry.name == ORACLE:
            best, shown_reward = choose_oracle(solver, place, conditions, job.seed)
            act = best.actions
        return _row(job, checkpoint, final(act), None, began, shown_reward)
    method = make_entry(entry.name, task, checkpoint)
    lived = trials or (simulated if conditions.fresh else place)
    chosen = run_session(solver, method, lived, conditions, job.seed)
    curve = [estimated_reward(task, policy.actions, place, conditions, job.seed) for policy in chosen]
    return _row(job, checkpoint, final(chosen[-1].actions), curve, began, None)


def _run_recorded(job: Job, recorded: RecordedTrials) -> BenchmarkRow:
    """Run the session and judge its policies by the trials held out."""
    began = time.perf_counter()
    checkpoint = checkpoint_knowing(job.task, job.checkpoint, None, own_object=job.own_object)
    task, seed, name = recorded.task, job.seed, job.method
    shown, held = (recorded.permuted(seed) if name in CONTROLS else recorded).split(job.held_out, seed)
    place = FromRecordings(shown, held)
    session, scores = (
        replace(checkpoint, solver=with_listed_actions(checkpoint.solver, half.actions)) for half in (shown, held)
    )

    def judged(act: Commands) -> Estimate:
        return estimated_reward(task, act, place, job.conditions, seed)

    if name in (UDR, PERMUTED_UDR):
        last = mean_of([judged(policy.actions) for policy in udr_policies(scores.solver, seed)])
        return _row(job, checkpoint, last, None, began, None)
    if name == BEST_ACTION:
        return _row(job, checkpoint, judged(place.best_actions), None, began, None)
    method, final = (make_method(DEFAULT if name == PERMUTED else name, task, one) for one in (session, scores))
    histories = run_iterations(session.solver, method, place, job.conditions, seed)
    curve = [judged(final_policy(final, scores.solver, task, history).actions) for history in histories]
    return _row(job, checkpoint, curve[-1], curve, began, None)


def _row(
    job: Job,
    checkpoint: Checkpoint,
    last: Estimate,
    curve: Sequence[Estimate] | None,
    began: float,
    shown_reward: float | None,
) -> BenchmarkRow:
    """The row of a job. `curve` is None if there are no trials, because then the reward stays the same."""
    adaptation = checkpoint.solver.task.adaptation
    each = 0 if curve is None else job.conditions.particles * adaptation.trials_per_iteration
    curve = curve or [last]
    return BenchmarkRow(
        task=job.task,
        set=job.set,
        target=job.target,
        method=job.method,
        seed=job.seed,
        reward=last.mean,
        ci95=(last.low, last.high),
        real_trials=each * len(curve),
        simulations=simulations(job.method, checkpoint),
        wall_s=time.perf_counter() - began,
        curve=tuple((each * (k + 1), judged.mean) for k, judged in enumerate(curve)),
        shown=shown_reward,
    )


def simulations(method: str, checkpoint: Checkpoint) -> int:
    """True rollouts of Phase 1 that an entry needs."""
    match kind_of(Entry.parse(method).name).phase_1:
        case "episodes":
            return checkpoint.card.simulations
        case "dataset" if checkpoint.emulator is not None:
            return checkpoint.card.budget.rollouts + checkpoint.card.budget.denser
        case "dataset" if (grid := grid_behind(checkpoint.solver)) is not None:
            return int(grid.tensors["success"].size)
        case _:
            return 0
