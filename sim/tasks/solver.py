"""The contract of a solver: task policies of one task, and expectations of trials in its simulator.

These are two separate contracts: a session may take policies and expectations from different solvers. A task with exact
answers brings its own solver (`Task.exact`). The others are in `sim.solvers`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from hw.types import Array

T_co = TypeVar("T_co", covariant=True)
"""The task's type. A task names its own solver, so this module must not import the task."""

Executable = Callable[[Array, Array], bool]
"""(context (c,), action (a,)) in units -> whether the arm can do it within its limits."""


@dataclass(frozen=True)
class SolverSettings:
    """The resolution and caution of a solver's search."""

    candidates: int = 256
    scenarios: int = 16  # draws of parameters, nuisance and action error per action
    refine: int = 32  # points around the best action; 0: none
    kappa: float = 0.5  # the reward is mean - kappa * standard deviation of the ensemble
    attempts: int = 64  # candidates offered to the executability check before giving up


class SolvedPolicy(Protocol):
    """A task policy for one distribution of parameters, with its predicted reward."""

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if no good action can be executed."""
        ...

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check: for training in simulation."""
        ...

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of this policy at `context` if its parameters are true: mean, low, high."""
        ...


class PoliciesOf(Protocol[T_co]):
    """Task policies of one task. Parameters, contexts and actions are in units."""

    @property
    def task(self) -> T_co:
        """The task of the policies."""
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
    """Expectations of trials in the simulator of one task. Parameters, contexts and actions are in units."""

    @property
    def task(self) -> T_co:
        """The task of the trials."""
        ...

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """(B,) rewards in targets (B, p) of actions (B, G, a) at contexts (G, c) or (B, G, c), averaged over everything
        but B.
        """
        ...

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,) expected rewards of N executed trials: (N, p), (N, c), (N, a), (N, n)."""
        ...

    def trajectories(self, parameters: Array, action: Array, nuisance: Array) -> Array:
        """(N, size) expected observations at the task's reference context, without camera noise."""
        ...

    def outcomes(self, parameters: Array, action: Array, nuisance: Array) -> tuple[Array, Array]:
        """(..., p), (..., a), (..., n), broadcast -> chance of success (M, ...) and end state of a success (M, ..., k).

        M is the size of the ensemble, or 1.
        """
        ...

    @property
    def residual_std(self) -> Array:
        """(size,) spread of the errors of `trajectories`, normalised."""
        ...

    @property
    def misfit_limit(self) -> float:
        """The misfit (see `sim.solvers.misfit`) that 95 % of simulated trials inside the ranges do not exceed."""
        ...


class SolverOf(PoliciesOf[T_co], ExpectationsOf[T_co], Protocol[T_co]):
    """Both at once, as pretraining needs them."""
