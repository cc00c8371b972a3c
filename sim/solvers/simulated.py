"""Expectations by true rollouts, for a solver that has only the simulator.

Expected rewards are means of `REWARD_ROLLOUTS` (unbiased, but noisy); trial rewards and trajectories are the
simulator's own.
"""

from __future__ import annotations

from abc import ABC

import numpy as np

from hw.types import Array
from sim.rollouts.draws import Disturbances
from sim.rollouts.run import Requests, Roll
from sim.tasks.task import Task
from sim.types import PredictedOutcomes

REWARD_ROLLOUTS = 8
"""Rollouts behind one expected reward.

A mean of eight has an error of about 0.15; Phase 1 averages over ten thousand steps.
"""


class FromSimulator(ABC):
    """The `sim.solvers.solver.Expectations` of a solver that asks the simulator, except its `misfit_limit`."""

    task: Task
    roll: Roll

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """(B,) means of true rollouts in targets (B, p) of actions (B, G, a) at contexts (G, c) or (B, G, c).

        `draws` rollouts per context, or at least `REWARD_ROLLOUTS` per target, spread evenly over contexts; the same
        action errors and nuisance for all targets.
        """
        count, g = actions.shape[:2]
        repeats = min(draws, -(-REWARD_ROLLOUTS // g))
        drawn, a = Disturbances.evenly(self.task, g * repeats, rng), len(self.task.action)
        everywhere = np.broadcast_to(contexts, (count, g, contexts.shape[-1]))
        where = np.repeat(everywhere, repeats, axis=1).reshape(count * g * repeats, -1)
        requests = Requests(
            parameters=np.repeat(targets, g * repeats, axis=0),
            context=where,
            action=(actions[:, :, None] + drawn.error.reshape(g, repeats, a)).reshape(len(where), a),
            nuisance=np.tile(drawn.nuisance, (count, 1)),
        )
        return np.asarray(self.roll(requests).rewards(self.task, where).reshape(count, -1).mean(axis=1))

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,) rewards of the same trials in the simulator; exact, not estimated."""
        return self.roll(Requests(parameters, contexts, action, nuisance)).rewards(self.task, contexts)

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """(N, size) of the same trials in the simulator."""
        contexts = np.broadcast_to(self.task.simulated_in(context), (len(parameters), len(self.task.context)))
        rollouts = self.roll(Requests(parameters, contexts, action, nuisance))
        return self.task.at_context(rollouts.observation, context)

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """Outcomes of the same trials in the simulator: (1, ...) and (1, ..., k); 0 for a failure."""
        requests, lead = Requests.broadcast(parameters, self.task.simulated_in(context), action, nuisance)
        return self.roll(requests).outcomes((1, *lead))

    @property
    def residual_std(self) -> Array:
        """(size,) zero: the trajectories are the simulator's own."""
        return np.zeros(self.task.observation.size)
