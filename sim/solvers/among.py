"""A solver for which only listed actions exist: those that were recorded, or those that a search tries.

Policies choose by expected reward; predictions are those of the solver behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hw.types import Array, frozen_array
from sim.errors import NotExecutable
from sim.rollouts.draws import Disturbances
from sim.solvers.solver import Executable, Expectations, SolvedPolicy, Solver, SolverSettings
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class Among:
    """A `sim.solvers.solver.Solver` with the actions (A, a), in units."""

    behind: Expectations
    listed: Array

    @property
    def task(self) -> Task:
        """The task of the solver behind it."""
        return self.behind.task

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[SolvedPolicy, ...]:
        """One policy for each of B distributions, samples (B, m, p) in units; the same draws for all."""
        settings = settings or SolverSettings()
        m = samples.shape[1]
        n = max(settings.scenarios if _varies(self.task) else 1, min(m, 4 * settings.scenarios))
        drawn = Disturbances.evenly(self.task, n, rng)
        return tuple(
            ListedPolicy(self.behind, self.listed, parameters, drawn, settings, executable)
            for parameters in samples[:, np.arange(n) % m]
        )

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.expected_rewards(targets, contexts, actions, rng, draws)

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.trial_rewards(parameters, contexts, action, nuisance)

    def trajectories(self, parameters: Array, action: Array, nuisance: Array) -> Array:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.trajectories(parameters, action, nuisance)

    def outcomes(self, parameters: Array, action: Array, nuisance: Array) -> tuple[Array, Array]:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.outcomes(parameters, action, nuisance)

    @property
    def residual_std(self) -> Array:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.residual_std

    @property
    def misfit_limit(self) -> float:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.misfit_limit


@dataclass(frozen=True, eq=False)
class ListedPolicy:
    """A `SolvedPolicy`: the listed action with the highest pessimistic reward."""

    behind: Expectations
    listed: Array  # (A, a)
    parameters: Array  # (S, p) of the scenarios
    drawn: Disturbances  # of the scenarios
    settings: SolverSettings
    executable: Executable | None

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if no listed action is left or can be executed."""
        return best_of(self.listed, self._worth(context), context, self.executable)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check."""
        return np.stack([self.listed[int(np.argmax(self._worth(context)))] for context in contexts])

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of its action: mean, and mean ± two standard deviations of the ensemble."""
        at = int(np.flatnonzero((self.listed == self(context)).all(axis=1))[0])
        rewards = self._rewards(context)[:, at]
        mean, std = float(rewards.mean()), float(rewards.std())
        return mean, max(0.0, mean - 2.0 * std), min(1.0, mean + 2.0 * std)

    @cached_property
    def _outcomes(self) -> tuple[Array, Array]:
        """Success (M, A, S), end state (M, A, S, k)."""
        executed = self.listed[:, None, :] + self.drawn.error
        return self.behind.outcomes(self.parameters, executed, self.drawn.nuisance)

    def _rewards(self, context: Array) -> Array:
        """(M, A) averaged over the scenarios."""
        success, end = self._outcomes
        return np.asarray((success * self.behind.task.reward_of_success(end, context)).mean(axis=-1))

    def _worth(self, context: Array) -> Array:
        rewards = self._rewards(context)
        return np.asarray((rewards.mean(axis=0) - self.settings.kappa * rewards.std(axis=0)).round(9))


def among(solver: Solver, listed: Array) -> Among:
    """The solver for which only the actions (A, a) exist."""
    return Among(solver.behind if isinstance(solver, Among) else solver, frozen_array(listed, (None, None), "actions"))


def best_of(listed: Array, worth: Array, context: Array, executable: Executable | None) -> Array:
    """The first executable one of listed actions (A, a), by falling worth (A,). Raises NotExecutable."""
    for i in np.argsort(-worth, kind="stable"):
        if executable is None or executable(context, listed[i]):
            return frozen_array(listed[i])
    raise NotExecutable(
        f"none of the {len(listed)} listed actions is left that can be executed for context {np.round(context, 4)}: "
        "end the session here, or list more actions"
    )


def _varies(task: Task) -> bool:
    return bool(len(task.nuisance)) or bool(np.any(task.action_noise))
