"""Bayesian optimisation of E with a prior that is learnt from Phase 1: an empirical Gaussian process.

Every candidate truth of the checkpoint's prospects acts as a past task, with the reward of each candidate E. Mean and
covariance over these tasks are the prior over E, which real rewards then condition. Trajectories are not used, so the
difference to `adaptsim-belief` shows the value of trajectories. The expected improvement is in closed form (Jones et
al. 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.adaptation.reward_table import RewardTable
from sim.errors import CheckpointError
from sim.tasks.task import Task

LEVEL_STD, ODD_STD = 0.1, 0.05
"""Standard deviations of real rewards from all past tasks: one for all E together, one for each E."""


def create(task: Task, checkpoint: Checkpoint | None) -> BoPrior:
    """The method's entry in `METHODS`. Raises CheckpointError if the checkpoint has no prospects."""
    if checkpoint is None or checkpoint.prospects is None:
        why = "there is none" if checkpoint is None else f"{checkpoint.path} holds no prospects"
        raise CheckpointError(
            f"bo-prior needs the prospects of a checkpoint, and {why}: make one with `adaptsim pretrain --task "
            f"{task.name}`"
        )
    return BoPrior(task, checkpoint.prospects)


@dataclass(frozen=True, eq=False)
class BoPrior:
    """A deterministic `Method`."""

    task: Task
    prospects: RewardTable

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The E with the highest mean reward in past tasks, and those with the largest expected improvement."""
        return self._chosen([], n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles, by the rewards of all trials."""
        return self._chosen(history, len(history[-1]))

    def conditioned(self, history: Sequence[Iteration]) -> tuple[Array, Array]:
        """Mean (C,) and covariance (C, C) of the rewards of the candidates, given those of the trials."""
        rewards = self.prospects.rewards
        mean, odd = rewards.mean(axis=1), ODD_STD**2 * np.eye(len(rewards))
        covariance = np.cov(rewards) + LEVEL_STD**2 + odd
        seen = [(tried.particle, [t.reward for t in tried.trials]) for it in history for tried in it if tried.trials]
        if not seen:
            return mean, covariance
        at = np.array([self._nearest(particle) for particle, _ in seen], dtype=np.intp)
        noise = self.task.adaptation.trial_std**2 / np.array([len(r) for _, r in seen])
        return _condition(mean, covariance, at, np.array([np.mean(r) for _, r in seen]), noise)

    def _chosen(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        """The E with the best mean, then those with the largest expected improvement, each treated as tried."""
        mean, covariance = self.conditioned(history)
        chosen = [int(np.argmax(mean))]
        while len(chosen) < n:
            std = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
            z = (mean - mean.max()) / std
            improvement = std * (z * norm.cdf(z) + norm.pdf(z))
            improvement[chosen] = -np.inf
            nxt = int(np.argmax(improvement))
            trials = self.task.adaptation.trials_per_iteration
            noise = np.array([self.task.adaptation.trial_std**2 / trials])
            mean, covariance = _condition(mean, covariance, np.array([nxt], dtype=np.intp), mean[[nxt]], noise)
            chosen.append(nxt)
        return tuple(Particle(self.prospects.candidates[i][None]) for i in chosen)

    def _nearest(self, particle: Particle) -> int:
        space = self.task.parameters
        gaps = space.normalise(self.prospects.candidates) - space.normalise(particle.mean)
        return int(np.linalg.norm(gaps, axis=1).argmin())


def _condition(
    mean: Array, covariance: Array, at: NDArray[np.intp], values: Array, noise: Array
) -> tuple[Array, Array]:
    """Rasmussen & Williams 2006, eq. 2.25 and 2.26, with the same E tried more than once allowed."""
    shared = covariance[:, at]
    gain = np.linalg.solve(covariance[np.ix_(at, at)] + np.diag(noise), shared.T).T
    return mean + gain @ (values - mean[at]), covariance - gain @ shared.T
