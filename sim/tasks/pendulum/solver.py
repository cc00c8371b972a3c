"""Exact task policies and rewards of the pendulum, without dataset or emulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array, frozen_array
from sim.tasks.pendulum.params import OBSERVATION
from sim.tasks.pendulum.rollout import INPUTS, STATES, WORTHLESS, excess, observed_many, optimal, reward_of_success
from sim.tasks.task import Executable, SolverSettings, Task
from sim.types import PredictedOutcomes


@dataclass(frozen=True, eq=False)
class LqrPolicy:
    """The optimal gain for the mean of one distribution."""

    samples: Array  # (m, 4) the distribution, in units
    gain: Array  # (8,)

    def __call__(self, context: Array) -> Array:
        """(0,) -> (8,), the gain."""
        return self.gain

    def actions(self, contexts: Array) -> Array:
        """(G, 0) -> (G, 8)."""
        return np.tile(self.gain, (len(contexts), 1))

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Predicted reward: mean over the distribution, and its central 95 %; 1 for a single sample."""
        earned = rewards(self.samples, self.gain)
        low, high = np.quantile(earned, [0.025, 0.975])
        return float(earned.mean()), float(low), float(high)


@dataclass(frozen=True, eq=False)
class LqrSolver:
    """The pendulum's `sim.tasks.task.Solver`."""

    task: Task

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[LqrPolicy, ...]:
        """Policies of B distributions, samples (B, m, 4). Needs no search, and every action is executable."""
        gains, _ = optimal(samples.mean(axis=1))
        return tuple(
            LqrPolicy(frozen_array(s), frozen_array(k.reshape(-1))) for s, k in zip(samples, gains, strict=True)
        )

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 1
    ) -> Array:
        """(B,) rewards in targets (B, 4) of actions (B, G, 8). Contexts are all equal, so the first one is enough."""
        return rewards(targets, actions[:, 0])

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,)"""
        return rewards(parameters, action)

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """(N, 24)"""
        return observed_many(parameters, np.broadcast_to(action, (len(parameters), 8)))

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """Whether the loop is stable (1, ...), and the end state (1, ..., 1), 0 if unstable."""
        spent = _excess(parameters, action)
        stable = np.isfinite(spent)
        end = np.where(stable, np.minimum(spent, WORTHLESS), 0.0)
        return PredictedOutcomes(stable[None].astype(np.float64), end[None, ..., None])

    @property
    def residual_std(self) -> Array:
        """(24,) zero: its trajectories are the simulator's own."""
        return np.zeros(OBSERVATION.size)

    @property
    def misfit_limit(self) -> float:
        """The misfit limit, which was measured on targets in Omega under the gain of another E."""
        return _MISFIT_LIMIT


def rewards(parameters: Array, action: Array) -> Array:
    """(..., 4), (..., 8), broadcast -> rewards (...): 0 if the loop is unstable."""
    return np.asarray(reward_of_success(_excess(parameters, action)[..., None], np.zeros(0)))


def _excess(parameters: Array, action: Array) -> Array:
    """(..., 4), (..., 8), broadcast -> excess (...): infinite if the loop is unstable."""
    lead = np.broadcast_shapes(parameters.shape[:-1], action.shape[:-1])
    gains = np.broadcast_to(action, (*lead, INPUTS * STATES)).reshape(*lead, INPUTS, STATES)
    return excess(np.broadcast_to(parameters, (*lead, STATES)), gains)


_MISFIT_LIMIT = 2.7
