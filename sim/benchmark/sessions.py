"""Whole sessions of a method in one world, and what they are measured against.

Every method meets the same contexts, errors of execution and noise of observation: all chance of a trial follows from
(seed, iteration, particle) and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from hw.types import Array
from sim.adaptation.best import choose_best
from sim.adaptation.method import Iteration, Method, OwnPolicies, Particle, ParticleTrials, Trial
from sim.adaptation.methods import udr
from sim.benchmark.places import Place
from sim.errors import OutOfRange
from sim.rollouts.draws import cover
from sim.solvers.solver import Executable, SolvedPolicy, Solver, policy_for
from sim.tasks.task import Task
from sim.types import Space

UDR_POLICIES = 8
"""Behind what UDR earns: over Omega many actions earn alike, and in one world they differ as success and failure."""

SCREENING, FINAL = 16, 6
"""Trials by which the oracle leaves `FINAL` of its policies; these get as many as a score rests on."""

Commands = Callable[[Array], Array]
"""Contexts (N, c) -> actions (N, a)."""


@dataclass(frozen=True)
class Conditions:
    """What all methods have in common."""

    budget: int  # real trials of a session; whole iterations of it are used
    particles: int = 2
    judged: int = 64  # rollouts behind each reward
    fresh: int = 0  # true rollouts behind the final one, and trials that are true ones; 0: all is looked up in tables
    candidates: int = 96  # E, evenly over Omega, that the oracle chooses from

    def iterations(self, task: Task) -> int:
        """Raises OutOfRange where the budget is less than one iteration."""
        each = self.particles * task.adaptation.trials_per_iteration
        if self.budget < each:
            raise OutOfRange(
                f"a budget of {self.budget} trials is less than one iteration of {task.name} with {self.particles} "
                f"particles, which takes {each}"
            )
        return self.budget // each


@dataclass(frozen=True, eq=False)
class Judged:
    """What one policy earns."""

    reward: float
    ci95: tuple[float, float]  # of the mean over the rollouts


class _Chance(IntEnum):
    """What a stream of random numbers is for."""

    CONTEXT = 0
    TRIAL = 1
    START = 2
    NEXT = 3
    JUDGE_CONTEXT = 4
    JUDGE = 5
    CHOOSE = 6
    UDR = 7


def run_session(
    solver: Solver, method: Method, place: Place, conditions: Conditions, seed: int, contexts: Space | None = None
) -> list[SolvedPolicy]:
    """The policies that the session would go with after each iteration; `contexts` are all the task's if not given."""
    task, history, chosen = solver.task, list[Iteration](), list[SolvedPolicy]()
    among = task.context if contexts is None else contexts
    trained: dict[bytes, SolvedPolicy] = {}

    def policy(particle: Particle) -> SolvedPolicy:
        if isinstance(method, OwnPolicies):
            return method.policy(particle, history, place.executable)
        return _once(trained, solver, particle, place.executable)

    particles = method.start(conditions.particles, _stream(seed, _Chance.START))
    for i in range(conditions.iterations(task)):
        acting = [policy(particle) for particle in particles]
        history.append(
            tuple(
                ParticleTrials(particle, _trials(task, act, place, among, (seed, i, j)))
                for j, (particle, act) in enumerate(zip(particles, acting, strict=True))
            )
        )
        best = choose_best(task, history).particle
        chosen.append(method.final(history, place.executable) if isinstance(method, OwnPolicies) else policy(best))
        particles = method.next(history, _stream(seed, _Chance.NEXT, i))
    return chosen


def judge(task: Task, act: Commands, place: Place, conditions: Conditions, seed: int) -> Judged:
    """What these commands earn on average over contexts, by rollouts that no session has seen."""
    contexts = task.context.sample(_stream(seed, _Chance.JUDGE_CONTEXT), _worthwhile(task, conditions.judged))
    rewards = place.judge(contexts, act(contexts), _stream(seed, _Chance.JUDGE))
    half = 1.96 * float(rewards.std(ddof=1)) / len(rewards) ** 0.5
    mean = float(rewards.mean())
    return Judged(mean, (max(0.0, mean - half), min(1.0, mean + half)))


def udr_policies(solver: Solver, seed: int) -> tuple[SolvedPolicy, ...]:
    """Several for all of Omega; what UDR earns is the mean over them."""
    return udr.udr_policies(solver, _stream(seed, _Chance.UDR), UDR_POLICIES)


def choose_oracle(solver: Solver, place: Place, conditions: Conditions, seed: int) -> tuple[SolvedPolicy, float]:
    """The best of many E, chosen by trials in the world, in two rounds; and what it earned in the second."""
    task = solver.task
    grid = cover(task.parameters, conditions.candidates, np.random.default_rng(0))
    policies = solver.policies(grid[:, None, :], np.random.default_rng(0))
    first = [shown(task, policy.actions, place, SCREENING, seed) for policy in policies]
    left = [policies[i] for i in np.argsort(first)[-FINAL:]]
    second = [shown(task, policy.actions, place, conditions.judged, seed + 1) for policy in left]
    best = int(np.argmax(second))
    return left[best], second[best]


def shown(task: Task, act: Commands, place: Place, n: int, seed: int) -> float:
    """Mean reward over `n` trials as sessions have them: for choices, never for scores."""
    rng = _stream(seed, _Chance.CHOOSE)
    contexts = task.context.sample(rng, _worthwhile(task, n))
    return float(place.play(contexts, act(contexts), rng).rewards.mean())


def _worthwhile(task: Task, n: int) -> int:
    """`n` rollouts, or two where one is like another."""
    return n if len(task.context) or np.any(task.action_noise) else 2


def _once(
    trained: dict[bytes, SolvedPolicy], solver: Solver, particle: Particle, executable: Executable | None
) -> SolvedPolicy:
    key = particle.samples.tobytes()
    if key not in trained:
        trained[key] = policy_for(solver, particle.samples, executable)
    return trained[key]


def _trials(
    task: Task, policy: SolvedPolicy, place: Place, among: Space, which: tuple[int, int, int]
) -> tuple[Trial, ...]:
    """Those of one particle in one iteration; `which`: seed, iteration, particle."""
    seed, *where = which
    contexts = among.sample(_stream(seed, _Chance.CONTEXT, *where), task.adaptation.trials_per_iteration)
    actions = np.stack([policy(context) for context in contexts])
    seen = place.play(contexts, actions, _stream(seed, _Chance.TRIAL, *where))
    rows = zip(seen.contexts, actions, seen.observations, seen.rewards, seen.ends, strict=True)
    return tuple(Trial(c, a, o, float(r), end) for c, a, o, r, end in rows)


def _stream(seed: int, chance: _Chance, *where: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(chance), *where)))
