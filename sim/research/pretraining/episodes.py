"""Meta-episodes: trials and rewards of parameter distributions in simulated targets, many at once.

`SolverActing` asks the solver again for the task policy of every distribution. `Library` solves some thousands of
distributions once, which fill Omega evenly, and uses the policy of the nearest one. This is the paper's reuse of task
policies (A2.2). Over four parameters the nearest of 2048 is 0.09 away on average, in normalised parameters; the paper
allows 0.16.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hw.types import Array
from perception.types import Outcome
from sim.adaptation.method import Trial, trials_of_rows
from sim.research.methods.q_policy import MemoryName, PastIterations, encode, look_back
from sim.rollouts.draws import cover, trial_requests
from sim.rollouts.run import OUTCOMES, Requests, Roll, Rollouts
from sim.solvers.emulator.network import Emulator
from sim.tasks.task import Solver, SolverSettings, Task

DRAWS = 4
"""Draws of action error and nuisance for each context of an expected reward."""

CONTEXTS = 16
"""Contexts of each distribution: some for its trials, all for its expected reward."""

LIBRARY = SolverSettings(scenarios=4, refine=16)
"""The resolution of its policies. In pushing, they earn 0.001 less than with the default, and cost a fifth as much."""

Acting = Callable[[Array, np.random.Generator], tuple[Array, Array]]
"""Means (B, p) -> contexts (B, G, c) that fill their space evenly, in random order, and the actions there (B, G, a)."""


@dataclass(frozen=True, eq=False)
class SolverActing:
    """An `Acting` whose task policies are the solver's for exactly these distributions."""

    solver: Solver
    settings: SolverSettings = field(default_factory=SolverSettings)

    def __call__(self, means: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Every distribution has contexts of its own."""
        task = self.solver.task
        policies = self.solver.policies(means[:, None, :], rng, settings=self.settings)
        contexts = np.stack([rng.permutation(cover(task.context, CONTEXTS, rng)) for _ in policies])
        return contexts, np.stack([policy.actions(c) for policy, c in zip(policies, contexts, strict=True)])


@dataclass(frozen=True, eq=False)
class Library:
    """An `Acting` that reuses the task policies of the distributions `means`."""

    task: Task
    means: Array  # (N, p) in units
    contexts: Array  # (N, G, c)
    actions: Array  # (N, G, a)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.task.parameters.normalise(self.means))

    def __call__(self, means: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Contexts and actions of the nearest distribution, in a new random order."""
        _, nearest = self._tree.query(self.task.parameters.normalise(means))
        order = rng.permuted(np.tile(np.arange(self.contexts.shape[1]), (len(means), 1)), axis=1)
        return self.contexts[nearest[:, None], order], self.actions[nearest[:, None], order]


def fill_library(
    solver: Solver,
    seed: int,
    size: int,
    settings: SolverSettings = LIBRARY,
    progress: Callable[[int, int], None] | None = None,
    at_once: int = 64,
) -> Library:
    """Solve `size` distributions that fill Omega evenly, `at_once` of them in memory."""
    rng = np.random.default_rng(seed)
    means, contexts, actions = cover(solver.task.parameters, size, rng), [], []
    solved = SolverActing(solver, settings)
    for start in range(0, size, at_once):
        where, what = solved(means[start : start + at_once], rng)
        contexts.append(where)
        actions.append(what)
        if progress is not None:
            progress(min(start + at_once, size), size)
    return Library(solver.task, means, np.concatenate(contexts), np.concatenate(actions))


@dataclass(frozen=True, eq=False)
class EmulatedRolls:
    """A `Roll`: one member of the ensemble answers each request, with its known residual error."""

    emulator: Emulator
    rng: np.random.Generator

    def __call__(self, requests: Requests) -> Rollouts:
        """One possible outcome of each request, without the camera's noise."""
        task = self.emulator.task
        drawn = self.emulator.draw(requests.parameters, requests.context, requests.action, requests.nuisance, self.rng)
        at_context = task.at_context(drawn.observation, requests.context)
        succeeded = drawn.success > 0.5
        return Rollouts(
            observation=at_context,
            end_state=np.where(succeeded[:, None], drawn.end_state, np.nan),
            succeeded=succeeded,
            outcome=np.full(len(requests), OUTCOMES.index(Outcome.SETTLED), dtype=np.int8),  # not used
            failure_reward=drawn.failure_reward,
        )


@dataclass(frozen=True, eq=False)
class Simulator:
    """The world of the episodes: the task policies, a source of trials, and the rewards that they may expect."""

    solver: Solver  # of the expected rewards
    acting: Acting
    roll: Roll  # of the observations: emulated ones, or those of the simulator


@dataclass(frozen=True, eq=False)
class Visit:
    """Trials and rewards of B distributions in their targets."""

    contexts: Array  # (B, T * c) normalised
    observations: Array  # (B, T * size) normalised, with camera noise
    trial_rewards: Array  # (B, T)
    rewards: Array  # (B,) expected by the solver


def visit(simulator: Simulator, means: Array, targets: Array, rng: np.random.Generator) -> Visit:
    """Run the task policies of `means` (B, p) `trials_per_iteration` times in their targets (B, p).

    The reward is the solver's expectation over contexts, nuisance and action error, which would need hundreds of
    rollouts; the evaluation compares it with true rollouts.
    """
    solver, task = simulator.solver, simulator.solver.task
    trials, count = task.adaptation.trials_per_iteration, len(means)
    contexts, actions = simulator.acting(means, rng)
    own = contexts[:, :trials].reshape(count * trials, -1)
    requests = trial_requests(
        task, np.repeat(targets, trials, axis=0), own, actions[:, :trials].reshape(count * trials, -1), rng
    )
    rollouts = simulator.roll(requests)
    observations = task.observation.with_noise(rollouts.observation, rng)
    return Visit(
        contexts=task.context.normalise(own).reshape(count, -1),
        observations=observations.reshape(count, -1),
        trial_rewards=rollouts.rewards(task, own).reshape(count, -1),
        rewards=solver.expected_rewards(targets, contexts, actions, rng, DRAWS),
    )


@dataclass(frozen=True, eq=False)
class Episodes:
    """In each of E targets, P particles adapt over H steps. Each of them is one episode, and is visited H + 1 times."""

    targets: Array  # (E, p) in units
    means: Array  # (E, P, H + 1, p) in units
    contexts: Array  # (E, P, H + 1, T * c) normalised
    observations: Array  # (E, P, H + 1, T * size) normalised, with camera noise
    trial_rewards: Array  # (E, P, H + 1, T)
    rewards: Array  # (E, P, H + 1) expected
    directions: Array  # (E, P, H, p) in {-1, 0, 1}

    def state(self, task: Task, memory: MemoryName, t: int) -> Array:
        """(E * P, inputs) the input of a policy with this memory after the visit `t`."""
        until = slice(0, t + 1)
        return encode(task, memory, self._seen(until))

    def _seen(self, until: slice) -> PastIterations:
        return look_back(
            self.means[:, :, until],
            self.observations[:, :, until],
            self.contexts[:, :, until],
            self.trial_rewards[:, :, until],
        )


class Running:
    """Episodes that run, all at the same step: P particles in each of E targets."""

    def __init__(self, simulator: Simulator, targets: Array, particles: int, rng: np.random.Generator) -> None:
        """Visit random places of all particles; targets (E, p) in units."""
        self._simulator, self._rng, self._shape = simulator, rng, (len(targets), particles)
        self._task = simulator.solver.task
        self._targets = np.repeat(targets, particles, axis=0)
        self._directions: list[NDArray[np.int_]] = []
        self._means = [self._task.parameters.sample(rng, len(self._targets))]
        self._visits = [self._visit()]

    def _visit(self) -> Visit:
        return visit(self._simulator, self._means[-1], self._targets, self._rng)

    def state(self, memory: MemoryName) -> Array:
        """(E * P, inputs) the present input of a policy with this memory."""
        return self.episodes().state(self._task, memory, len(self._directions))

    def step(self, directions: NDArray[np.int_]) -> Array:
        """Move the means (E * P, p), visit the new ones, and return their expected rewards (E * P,)."""
        self._directions.append(directions)
        self._means.append(self._task.parameters.step(self._means[-1], directions, self._task.adaptation.delta))
        self._visits.append(self._visit())
        return self._visits[-1].rewards

    def episodes(self) -> Episodes:
        """The episodes until now."""

        def grouped(rows: Sequence[Array]) -> Array:
            """A sequence of n arrays (E * P, ...) -> (E, P, n, ...)"""
            return np.stack(rows, axis=1).reshape(*self._shape, len(rows), *np.shape(rows[0])[1:])

        moved = [np.asarray(d, dtype=np.float64) for d in self._directions]
        return Episodes(
            targets=self._targets[:: self._shape[1]],
            means=grouped(self._means),
            contexts=grouped([v.contexts for v in self._visits]),
            observations=grouped([v.observations for v in self._visits]),
            trial_rewards=grouped([v.trial_rewards for v in self._visits]),
            rewards=grouped([v.rewards for v in self._visits]),
            directions=grouped(moved) if moved else np.zeros((*self._shape, 0, len(self._task.parameters))),
        )


def join_episodes(parts: Sequence[Episodes]) -> Episodes:
    """All episodes as one, in the order of the parts."""
    return Episodes(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Episodes)))


def sparse(task: Task, rewards: Array) -> Array:
    """The rewards that reach the task's threshold; all others become 0 (paper, eq. A1)."""
    return np.where(rewards >= task.adaptation.threshold, rewards, 0.0)


def simulated_trials(
    task: Task, policy: Callable[[Array], Array], target: Array, roll: Roll, n: int, rng: np.random.Generator
) -> tuple[Trial, ...]:
    """`n` trials of a policy in a simulated target (p,), in a session's form."""
    contexts = task.context.sample(rng, n)
    actions = np.stack([policy(c) for c in contexts])
    results = roll(trial_requests(task, np.tile(target, (n, 1)), contexts, actions, rng))
    observations = task.observation.with_noise(results.observation, rng)
    return trials_of_rows(contexts, actions, observations, results.rewards(task, contexts), results.ends())
