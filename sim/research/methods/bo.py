"""Bayesian optimisation of E on real rewards only (Muratore et al. 2021): the task-driven baseline of the paper.

A Gaussian process over the normalised means of E is fitted to the rewards of all trials, with their known spread; the
next particles jointly maximise the noisy expected improvement. Trajectories and contexts are not used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.research.methods.extras import calculating, require
from sim.rollouts.draws import cover
from sim.tasks.task import Task

CANDIDATES = 256
"""Number of E, spread evenly over Omega, among which the improvement is maximised. So integers need no relaxation."""


def create(task: Task, checkpoint: Checkpoint | None) -> BayesianOptimisation:
    """The method's entry in `METHODS`; it needs no checkpoint. Raises ExtraMissing."""
    require("bo", "botorch", "bo")
    return BayesianOptimisation(task)


@dataclass(frozen=True, eq=False)
class BayesianOptimisation:
    """A `Method`."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """Means spread over Omega, like those of the paper's policy."""
        return tuple(Particle(mean[None]) for mean in self._spread(n, rng))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The particles with the largest joint expected improvement."""
        space, n = self.task.parameters, len(history[-1])
        seen = [(tried.particle.mean, t.reward) for it in history for tried in it for t in tried.trials]
        if not seen:
            return tuple(tried.particle for tried in history[-1])
        tried, rewards = space.normalise(np.array([mean for mean, _ in seen])), np.array([r for _, r in seen])
        means = self._spread(CANDIDATES, rng)
        chosen = _maximise(
            tried, rewards, self.task.adaptation.trial_std, space.normalise(means), n, int(rng.integers(2**31))
        )
        return tuple(Particle(means[i][None]) for i in chosen)

    def _spread(self, n: int, rng: np.random.Generator) -> Array:
        return cover(self.task.parameters, n, rng)


def _maximise(tried: Array, rewards: Array, std: float, candidates: Array, n: int, seed: int) -> list[int]:
    """Indices of the `n` of `candidates` (C, p) with the largest joint improvement over `tried` (N, p), (N,)."""
    with calculating(seed):
        from botorch.acquisition.logei import qLogNoisyExpectedImprovement  # noqa: PLC0415 - an extra, slow to load
        from botorch.fit import fit_gpytorch_mll  # noqa: PLC0415
        from botorch.models import SingleTaskGP  # noqa: PLC0415
        from botorch.models.transforms import Standardize  # noqa: PLC0415
        from botorch.optim import optimize_acqf_discrete  # noqa: PLC0415
        from gpytorch.mlls import ExactMarginalLogLikelihood  # noqa: PLC0415

        X, Y = torch.from_numpy(tried), torch.from_numpy(rewards)[:, None]
        scaled = Standardize(1) if np.ptp(rewards) > 0.0 else None
        model = SingleTaskGP(X, Y, torch.full_like(Y, std**2), outcome_transform=scaled)
        fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
        improvement = qLogNoisyExpectedImprovement(model, X, prune_baseline=True)
        points, _ = optimize_acqf_discrete(improvement, n, torch.from_numpy(candidates), unique=True)
    return [int(np.linalg.norm(candidates - point, axis=1).argmin()) for point in points.numpy()]
