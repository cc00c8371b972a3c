"""Whole sessions of a method in one world, and the references with which they are compared.

Every method gets the same contexts, action errors and observation noise: all randomness of a trial depends only on
(seed, iteration, particle).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from hw.types import Array
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.judging import final_policy
from sim.adaptation.method import Iteration, Method, Trial
from sim.adaptation.methods import udr
from sim.adaptation.sessions import begin_in_memory
from sim.errors import OutOfRange
from sim.research.benchmark.trial_sources import TrialSource
from sim.rollouts.draws import cover
from sim.tasks.task import SolvedPolicy, Solver, Task
from sim.types import Estimate

SCREENING, FINAL = 16, 6
"""Trials per policy in the oracle's first round, after which `FINAL` policies are left. These get as many trials as a
score."""

Commands = Callable[[Array], Array]
"""Contexts (N, c) -> actions (N, a)."""


@dataclass(frozen=True)
class Conditions:
    """The common conditions of all methods."""

    budget: int  # real trials of a session, rounded down to whole iterations
    particles: int = 2
    judged: int = 64  # rollouts behind each reward
    fresh: int = 0  # true rollouts behind the final reward; then the trials are true rollouts, too. 0: all from tables
    candidates: int = 96  # candidate E of the oracle, spread evenly over Omega

    def iterations(self, task: Task) -> int:
        """The number of iterations. Raises OutOfRange if the budget is less than one iteration."""
        each = self.particles * task.adaptation.trials_per_iteration
        if self.budget < each:
            raise OutOfRange(
                f"a budget of {self.budget} trials is less than one iteration of {task.name} with {self.particles} "
                f"particles, which takes {each}"
            )
        return self.budget // each


class _Chance(IntEnum):
    """The purpose of a stream of random numbers."""

    CONTEXT = 0
    TRIAL = 1
    START = 2
    NEXT = 3
    JUDGE_CONTEXT = 4
    JUDGE = 5
    CHOOSE = 6
    UDR = 7


def run_session(
    solver: Solver, method: Method, source: TrialSource, conditions: Conditions, seed: int
) -> list[SolvedPolicy]:
    """The final policies that the session would have if it ended after each iteration."""
    histories = run_iterations(solver, method, source, conditions, seed)
    return [final_policy(method, solver, solver.task, history, source.executable) for history in histories]


def run_iterations(
    solver: Solver, method: Method, source: TrialSource, conditions: Conditions, seed: int
) -> Iterator[tuple[Iteration, ...]]:
    """The history of a session after each iteration."""
    task = solver.task

    def play(policy: SolvedPolicy, iteration: int, particle: int) -> tuple[Trial, ...]:
        return _trials(task, policy, source, (seed, iteration, particle))

    session = begin_in_memory(
        Adaptation(method, solver, solver, source.executable),
        play,
        (conditions.particles, task.adaptation.trials_per_iteration),
        _stream(seed, _Chance.START),
        lambda iteration: _stream(seed, _Chance.NEXT, iteration),
    )
    return session.iterations(conditions.iterations(task))


def estimated_reward(task: Task, act: Commands, source: TrialSource, conditions: Conditions, seed: int) -> Estimate:
    """The mean reward of these commands over contexts, by rollouts that no session uses."""
    contexts = judged_contexts(task, conditions, seed)
    rewards = source.score(contexts, act(contexts), _stream(seed, _Chance.JUDGE))
    half = 1.96 * float(rewards.std(ddof=1)) / len(rewards) ** 0.5
    mean = float(rewards.mean())
    return Estimate(mean, max(0.0, mean - half), min(1.0, mean + half))


def judged_contexts(task: Task, conditions: Conditions, seed: int) -> Array:
    """(N, c) the contexts in which `estimated_reward` scores."""
    return task.context.sample(_stream(seed, _Chance.JUDGE_CONTEXT), _worthwhile(task, conditions.judged))


def mean_of(judged: Sequence[Estimate]) -> Estimate:
    """The mean of policies that are judged on the same contexts. The mean of their intervals is a cautious interval."""
    n = len(judged)
    return Estimate(*(sum(getattr(one, end) for one in judged) / n for end in ("mean", "low", "high")))


def udr_policies(solver: Solver, seed: int) -> tuple[SolvedPolicy, ...]:
    """Several policies for all of Omega; UDR's reward is their mean."""
    return udr.udr_policies(solver, _stream(seed, _Chance.UDR))


def choose_oracle(solver: Solver, source: TrialSource, conditions: Conditions, seed: int) -> tuple[SolvedPolicy, float]:
    """The best of many E, chosen by trials in the world in two rounds, and its reward in the second."""
    task = solver.task
    grid = cover(task.parameters, conditions.candidates, np.random.default_rng(0))
    policies = solver.policies(grid[:, None, :], np.random.default_rng(0))
    first = [mean_played_reward(task, policy.actions, source, SCREENING, seed) for policy in policies]
    left = [policies[i] for i in np.argsort(first)[-FINAL:]]
    second = [mean_played_reward(task, policy.actions, source, conditions.judged, seed + 1) for policy in left]
    best = int(np.argmax(second))
    return left[best], second[best]


def mean_played_reward(task: Task, act: Commands, source: TrialSource, n: int, seed: int) -> float:
    """Mean reward over `n` trials of the kind that sessions have. It is used for choices, never for scores."""
    rng = _stream(seed, _Chance.CHOOSE)
    contexts = task.context.sample(rng, _worthwhile(task, n))
    return float(np.mean([trial.reward for trial in source.play(contexts, act(contexts), rng)]))


def _worthwhile(task: Task, n: int) -> int:
    """`n` rollouts, or two if all rollouts are the same."""
    return n if len(task.context) or np.any(task.action_noise) else 2


def _trials(task: Task, policy: SolvedPolicy, source: TrialSource, which: tuple[int, int, int]) -> tuple[Trial, ...]:
    """The trials of one particle in one iteration; `which` is (seed, iteration, particle)."""
    seed, *where = which
    contexts = task.context.sample(_stream(seed, _Chance.CONTEXT, *where), task.adaptation.trials_per_iteration)
    chosen = []
    for context in contexts:
        chosen.append(policy(context))
        source.take(chosen[-1])
    actions = np.stack(chosen)
    return source.play(contexts, actions, _stream(seed, _Chance.TRIAL, *where))


def _stream(seed: int, chance: _Chance, *where: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(chance), *where)))
