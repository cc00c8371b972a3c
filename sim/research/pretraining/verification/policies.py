"""Compares task policies from the emulator with policies found by true rollouts only, both run in the simulator.

Both kinds are trained for the same environments E in Omega and run in the same targets E_s, with the same contexts,
action errors and nuisance. The same rewards show how well the emulator ranks the policies of all E in one target.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from hw.types import Array
from sim.research.pretraining.verification.statistics import RankCorrelation, clustered, rank_correlation
from sim.rollouts.draws import at_reference, cover, sobol, trial_requests
from sim.rollouts.run import Requests, Roll, Rollouts
from sim.solvers.solver import Solver
from sim.tasks.task import Task
from sim.types import Estimate

CONTEXTS = 16
"""Contexts, and draws at each, behind an expected reward of the emulator."""


@dataclass(frozen=True)
class PairSettings:
    """The number of environments and the resolution. The defaults take about 1,700 rollouts."""

    environments: int = 13
    targets: int = 4  # the first of the environments; with each E this gives 52 pairs
    actions: int = 48  # tried in each environment, for the policies by true rollouts
    rollouts: int = 10  # of each policy in each target

    @property
    def simulations(self) -> int:
        """Number of rollouts needed."""
        return self.environments * (self.actions + 2 * self.targets * self.rollouts)


@dataclass(frozen=True, eq=False)
class Pairs:
    """True rewards of n policies of each kind in t targets, with r rollouts each."""

    emulated: Array  # (n, t, r) of the policies from the emulator
    drake: Array  # (n, t, r) of those from true rollouts
    expected: Array  # (n, t) rewards of its policies expected by the emulator
    regret: Estimate  # drake - emulated, all pairs, bootstrap over E
    own_regret: Estimate  # the same for policies in their own parameters
    ranks: RankCorrelation
    actions: int  # rollouts to find each policy of `drake`

    @property
    def count(self) -> int:
        """Number of pairs (policy, target)."""
        return int(self.expected.size)


def compare_policies(solver: Solver, roll: Roll, settings: PairSettings, rng: np.random.Generator) -> Pairs:
    """Train both kinds of policies, and run them in every target."""
    task, n = solver.task, settings.environments
    environments = cover(task.parameters, n, rng)
    learnt = solver.policies(environments[:, None, :], rng)
    searched = search_policies(task, environments, roll, settings.actions, rng)
    shared = task.context.sample(rng, CONTEXTS)
    planned = np.stack([policy.actions(shared) for policy in learnt])
    earned, expected = [], []
    for target in environments[: settings.targets]:
        contexts, seed = task.context.sample(rng, settings.rollouts), int(rng.integers(2**31))
        actions = [policy.actions(contexts) for policy in learnt] + [policy.actions(contexts) for policy in searched]
        requests = [_at(task, target, contexts, a, np.random.default_rng(seed)) for a in actions]
        rewards = roll(reduce(Requests.followed_by, requests)).rewards(task, np.tile(contexts, (len(actions), 1)))
        earned.append(rewards.reshape(2, n, -1))
        expected.append(solver.expected_rewards(np.tile(target, (n, 1)), shared, planned, rng))
    emulated, drake = np.stack(earned, axis=2)  # (2, n, t, r)
    difference = (drake - emulated).mean(axis=2)  # (n, t)
    return Pairs(
        emulated=emulated,
        drake=drake,
        expected=np.stack(expected, axis=1),
        regret=clustered(difference.mean(axis=1), rng),
        own_regret=clustered(np.diag(difference), rng),
        ranks=rank_correlation(np.stack(expected, axis=1), emulated, rng),
        actions=settings.actions,
    )


@dataclass(frozen=True, eq=False)
class SearchedPolicy:
    """The best of a fixed set of actions by true rollouts in one environment, smoothed over neighbouring actions."""

    task: Task
    tried: Array  # (A, a) in units
    rollouts: Rollouts  # one per action, at the reference context
    weights: Array  # (A, A) of neighbours; rows sum to 1

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a). Contexts differ only by `Task.relocate`, so every rollout is scored at each of them."""
        rewards = [self.rollouts.rewards(self.task, np.tile(c, (len(self.tried), 1))) for c in contexts]
        return np.asarray(self.tried[np.argmax(np.stack(rewards) @ self.weights.T, axis=1)])


def search_policies(
    task: Task, environments: Array, roll: Roll, actions: int, rng: np.random.Generator
) -> tuple[SearchedPolicy, ...]:
    """One policy per environment (n, p), from one rollout of each of `actions` Sobol points of the action space.

    Action errors and nuisance are the same in all environments. A reward is averaged over neighbours closer than about
    the spacing of the points, which replaces repeated rollouts.
    """
    a = len(task.action)
    unit = sobol(actions, a, rng)
    tried = task.action.spread(unit)
    seed, contexts = int(rng.integers(2**31)), at_reference(task, actions)
    requests = [_at(task, e, contexts, tried, np.random.default_rng(seed)) for e in environments]
    results = roll(reduce(Requests.followed_by, requests))
    squared = ((unit[:, None] - unit) ** 2).sum(axis=-1)
    weights = np.exp(-squared / (2.0 * (0.5 * actions ** (-1.0 / a)) ** 2))
    weights /= weights.sum(axis=1, keepdims=True)
    return tuple(
        SearchedPolicy(task, tried, results[i * actions : (i + 1) * actions], weights) for i in range(len(environments))
    )


def _at(task: Task, target: Array, contexts: Array, actions: Array, rng: np.random.Generator) -> Requests:
    return trial_requests(task, np.tile(target, (len(actions), 1)), contexts, actions, rng)
