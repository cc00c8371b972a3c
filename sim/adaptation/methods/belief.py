"""AdaptSim by inference: infers the true parameters from all trajectories, and the E that would earn most there.

From thousands of sessions, the paper's adaptation policy learns in which direction to move E. With an emulator that
answers in microseconds, the question can be asked directly, for all trials at once and without a fixed step:

1. Each trajectory weighs candidate parameters by how well the emulator explains it there.
2. The expected reward of an E is the mean of its row of the reward table (`RewardTable`) under these weights.
3. No parameters describe the real object exactly. So this expectation is only the prior mean of a Gaussian process over
E, which the rewards of the trials correct. They change little if the simulator can express the object, and otherwise
they decide.

The first particle goes to the E with the largest expected reward, each other one to the E with the largest possible
gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.method import Iteration, Particle
from sim.adaptation.reward_table import RewardTable
from sim.adaptation.trajectory_likelihood import TrajectoryLikelihood
from sim.tasks.task import Expectations, Task

LEVEL_STD, REALITY_STD, LENGTH = 0.1, 0.15, 0.3
"""Standard deviations of real rewards from the simulator's: one for all E together, and one that varies over E.
`LENGTH`, in fractions of the ranges, is the distance over which it varies."""


def create(task: Task, checkpoint: Checkpoint | None) -> AdaptSimBelief:
    """The method's entry in `METHODS`. Raises CheckpointError if the checkpoint has no parts for inference."""
    reward_table = reward_table_of("adaptsim-belief", task, checkpoint)
    assert checkpoint is not None  # it holds the reward table
    return AdaptSimBelief(checkpoint.solver, reward_table)


@dataclass(frozen=True, eq=False)
class AdaptSimBelief:
    """A deterministic `Method` that uses all trials of the session."""

    expectations: Expectations
    reward_table: RewardTable

    @cached_property
    def likelihood(self) -> TrajectoryLikelihood:
        """The likelihood of the truths of `reward_table`."""
        return TrajectoryLikelihood(self.expectations, self.reward_table.truths, self.reward_table.prior)

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The E with the highest expected reward over all possible true parameters, and others that may earn more."""
        return self._best([], n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Deterministic; it does not depend on the earlier particles."""
        return self._best(history, len(history[-1]))

    def weights(self, history: Sequence[Iteration]) -> Array:
        """(T,) probabilities of the candidate truths of `reward_table`, given the trajectories."""
        return self.likelihood.weights_after_each(history)[-1]

    def estimate(self, history: Sequence[Iteration]) -> tuple[Array, Array]:
        """(C,) mean and (C,) standard deviation of the real reward of each candidate E: Rasmussen & Williams 2006,
        eq. 2.25, with the reward table as mean and covariance.
        """
        weights, earned = self.weights(history), self.reward_table.rewards
        task, mean = self.expectations.task, earned @ weights
        off = earned - mean[:, None]
        tried = [(entry.particle, [t.reward for t in entry.trials]) for it in history for entry in it if entry.trials]
        at = np.array([self.reward_table.nearest(task, particle) for particle, _ in tried], dtype=np.intp)
        unit = task.parameters.normalise(self.reward_table.candidates)
        squared = ((unit[:, None] - unit[at][None]) ** 2).sum(axis=-1)
        shared = (off * weights) @ off[at].T + LEVEL_STD**2 + REALITY_STD**2 * np.exp(-0.5 * squared / LENGTH**2)
        variance = (off**2) @ weights + LEVEL_STD**2 + REALITY_STD**2
        if tried:
            noise = task.adaptation.trial_std**2 / np.array([len(r) for _, r in tried])
            gain = np.linalg.solve(shared[at] + np.diag(noise), shared.T).T
            mean = mean + gain @ (np.array([np.mean(r) for _, r in tried]) - mean[at])
            variance = variance - (gain * shared).sum(axis=1)
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def _best(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        return self.reward_table.spread_out(self.expectations.task, *self.estimate(history), n)
