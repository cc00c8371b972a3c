"""What the task policies of distributions do, for episodes of adapting by the ten thousand.

`Solved` asks the solver anew for every distribution. `Library` solves some thousands of them once, which fill Omega
evenly, and lets every distribution act like its nearest one: the reuse of task policies of the paper (A2.2). Over four
parameters the nearest of 2048 is .09 away on average, in normalised parameters; the paper allows .16.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from hw.types import Array
from perception.types import Outcome
from sim.rollouts.draws import cover
from sim.rollouts.run import OUTCOMES, Requests, Rollouts
from sim.solvers.emulator.network import Emulator
from sim.solvers.solver import Solver, SolverSettings
from sim.tasks.task import Task

CONTEXTS = 16
"""Contexts of each distribution: some for its trials, all for its expected reward."""

LIBRARY = SolverSettings(scenarios=4, refine=16)
"""The resolution of its policies: in pushing they earn .001 less than with the default, at a fifth of its cost."""

Acting = Callable[[Array, np.random.Generator], tuple[Array, Array]]
"""Means (B, p) -> contexts (B, G, c) that fill their space evenly, in random order, and the actions there (B, G, a)."""


@dataclass(frozen=True, eq=False)
class Solved:
    """An `Acting` whose task policies are the solver's for exactly these distributions."""

    solver: Solver
    settings: SolverSettings = field(default_factory=SolverSettings)

    def __call__(self, means: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Each with contexts of its own."""
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
        """Those of the nearest distribution, in an order drawn anew."""
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
    solved = Solved(solver, settings)
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
        drawn = self.emulator.draw(requests.parameters, requests.action, requests.nuisance, self.rng)
        at_context = task.relocate(drawn.observation, requests.context)
        succeeded = drawn.success > 0.5
        return Rollouts(
            observation=at_context,
            end_state=np.where(succeeded[:, None], drawn.end_state, np.nan),
            succeeded=succeeded,
            outcome=np.full(len(requests), OUTCOMES.index(Outcome.SETTLED), dtype=np.int8),  # not used
        )
