"""The contract of a solver: task policies of one task, and what they earn in its simulator.

The two are contracts of their own: a session may take its policies from elsewhere than its expectations. A task with
exact answers brings its own solver (`Task.exact`). The others are in `sim.solvers`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from hw.types import Array

T_co = TypeVar("T_co", covariant=True)
"""The task. A task names its own solver, so the contract must not name the task."""

Executable = Callable[[Array, Array], bool]
"""(context (c,), action (a,)) in units -> whether the arm can do it within its limits."""


@dataclass(frozen=True)
class SolverSettings:
    """How finely a solver that has to search searches, and how cautious it is."""

    candidates: int = 256
    scenarios: int = 16  # parameters x nuisance x action errors an action is averaged over
    refine: int = 32  # points around the winner; 0: none
    kappa: float = 0.5  # reward counted: mean - kappa * standard deviation of the ensemble
    attempts: int = 64  # candidates offered to the executability check before giving up


class SolvedPolicy(Protocol):
    """A task policy, for one distribution of parameters, that can say what it expects."""

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable when nothing good enough can be executed."""
        ...

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check: for training in simulation."""
        ...

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of this policy at `context`, were its parameters true: mean, low, high."""
        ...


class PoliciesOf(Protocol[T_co]):
    """Task policies of one task. Parameters, contexts and actions are in units."""

    @property
    def task(self) -> T_co:
        """Whose policies it makes."""
        ...

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[SolvedPolicy, ...]:
        """One policy for each of B distributions, given as samples (B, m, p); the same draws for all."""
        ...


class ExpectationsOf(Protocol[T_co]):
    """What to expect of trials in the simulator of one task. Parameters, contexts and actions are in units."""

    @property
    def task(self) -> T_co:
        """Whose trials it speaks of."""
        ...

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """(B,) rewards in targets (B, p) of actions (B, G, a) at contexts (G, c), averaged over all but B."""
        ...

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,) expected rewards of N executed trials: (N, p), (N, c), (N, a), (N, n)."""
        ...

    def trajectories(self, parameters: Array, action: Array, nuisance: Array) -> Array:
        """(N, size) expected observations at the task's reference context, without camera noise."""
        ...

    def outcomes(self, parameters: Array, action: Array, nuisance: Array) -> tuple[Array, Array]:
        """(..., p), (..., a), (..., n), broadcast -> chance of success (M, ...) and end state of a success (M, ..., k).

        M opinions: those of an ensemble, or one.
        """
        ...

    @property
    def residual_std(self) -> Array:
        """(size,) spread of the errors of `trajectories`, normalised."""
        ...

    @property
    def misfit_limit(self) -> float:
        """Misfit (see `sim.solvers.misfit`) that 95 % of simulated trials inside the ranges stay below."""
        ...


class SolverOf(PoliciesOf[T_co], ExpectationsOf[T_co], Protocol[T_co]):
    """Both at once, as pretraining needs them."""
