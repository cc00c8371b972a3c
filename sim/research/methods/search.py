"""Searches E only by real rewards: at random, by Bayesian optimisation, or with a prior that is learnt from Phase 1.

Trajectories and contexts are not used, so the difference to `adaptsim-belief` shows the value of trajectories.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from io import StringIO

import numpy as np
from numpy.typing import NDArray

from hw.extras import missing
from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.method import Iteration, Particle
from sim.adaptation.reward_table import RewardTable
from sim.errors import ExtraMissing
from sim.rollouts.draws import cover
from sim.tasks.task import Task

CANDIDATES = 256
"""Number of E, spread evenly over Omega, among which the next ones are chosen, so that integers need no relaxation."""

LEVEL_STD, ODD_STD = 0.1, 0.05
"""Standard deviations of real rewards from all past tasks: one for all E together, one for each E."""


def create_random(task: Task, checkpoint: Checkpoint | None) -> RandomSearch:
    """The method's entry in `METHODS`; it needs no checkpoint."""
    return RandomSearch(task)


@dataclass(frozen=True, eq=False)
class RandomSearch:
    """A `Method`: each next particle is the random candidate farthest from all tried ones."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first particle is random; each other one is far from those before it."""
        return self._farthest(np.zeros((0, len(self.task.parameters))), n, rng)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Particles far from all tried ones, regardless of their rewards."""
        tried = np.array([entry.particle.mean for iteration in history for entry in iteration])
        return self._farthest(self.task.parameters.normalise(tried), len(history[-1]), rng)

    def _farthest(self, tried: Array, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        space = self.task.parameters
        means = cover(space, CANDIDATES, rng)
        unit = space.normalise(means)
        chosen: list[Particle] = []
        for _ in range(n):
            gaps = np.linalg.norm(unit[:, None] - tried[None], axis=-1).min(axis=1, initial=np.inf)
            pick = int(np.argmax(gaps)) if len(tried) else 0
            chosen.append(Particle(means[pick][None]))
            tried = np.concatenate([tried, unit[pick][None]])
        return tuple(chosen)


def create_bo(task: Task, checkpoint: Checkpoint | None) -> BayesianOptimisation:
    """The method's entry in `METHODS`; it needs no checkpoint. Raises ExtraMissing."""
    require("bo", "botorch", "bo")
    return BayesianOptimisation(task)


@dataclass(frozen=True, eq=False)
class BayesianOptimisation:
    """A `Method`: Bayesian optimisation of E (Muratore et al. 2021), the task-driven baseline of the paper.

    A Gaussian process over the normalised means of E is fitted to the rewards of all trials, with their known spread;
    the next particles jointly maximise the noisy expected improvement.
    """

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """Means spread over Omega, like those of the paper's policy."""
        return tuple(Particle(mean[None]) for mean in cover(self.task.parameters, n, rng))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The particles with the largest joint expected improvement."""
        space, n = self.task.parameters, len(history[-1])
        points = [(tried.particle.mean, t.reward) for it in history for tried in it for t in tried.trials]
        if not points:
            return tuple(tried.particle for tried in history[-1])
        tried, rewards = space.normalise(np.array([mean for mean, _ in points])), np.array([r for _, r in points])
        means = cover(space, CANDIDATES, rng)
        chosen = _maximise(
            tried, rewards, self.task.adaptation.trial_std, space.normalise(means), n, int(rng.integers(2**31))
        )
        return tuple(Particle(means[i][None]) for i in chosen)


def _maximise(tried: Array, rewards: Array, std: float, candidates: Array, n: int, seed: int) -> list[int]:
    """Indices of the `n` of `candidates` (C, p) with the largest joint improvement over `tried` (N, p), (N,)."""
    import torch  # noqa: PLC0415 - slow to load

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


def create_prior(task: Task, checkpoint: Checkpoint | None) -> BoPrior:
    """The method's entry in `METHODS`. Raises CheckpointError if the checkpoint has no reward table."""
    return BoPrior(task, reward_table_of("bo-prior", task, checkpoint))


@dataclass(frozen=True, eq=False)
class BoPrior:
    """A deterministic `Method`: Bayesian optimisation with a prior from Phase 1, an empirical Gaussian process.

    Every candidate truth of the reward table acts as a past task, with the reward of each candidate E. Mean
    and covariance over these tasks are the prior over E, which real rewards then condition. The expected improvement is
    in closed form (Jones et al. 1998).
    """

    task: Task
    reward_table: RewardTable

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The E with the highest mean reward in past tasks, and those with the largest expected improvement."""
        return self._chosen([], n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles, by the rewards of all trials."""
        return self._chosen(history, len(history[-1]))

    def conditioned(self, history: Sequence[Iteration]) -> tuple[Array, Array]:
        """Mean (C,) and covariance (C, C) of the rewards of the candidates, given those of the trials."""
        rewards = self.reward_table.rewards
        mean, odd = rewards.mean(axis=1), ODD_STD**2 * np.eye(len(rewards))
        covariance = np.cov(rewards) + LEVEL_STD**2 + odd
        evidence = [
            (tried.particle, [t.reward for t in tried.trials]) for it in history for tried in it if tried.trials
        ]
        if not evidence:
            return mean, covariance
        at = np.array([self.reward_table.nearest(self.task, particle) for particle, _ in evidence], dtype=np.intp)
        noise = self.task.adaptation.trial_std**2 / np.array([len(r) for _, r in evidence])
        return _condition(mean, covariance, at, np.array([np.mean(r) for _, r in evidence]), noise)

    def _chosen(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        """The E with the best mean, then those with the largest expected improvement, each treated as tried."""
        mean, covariance = self.conditioned(history)
        chosen = [int(np.argmax(mean))]
        while len(chosen) < n:
            from scipy.stats import norm  # noqa: PLC0415 - slow to load

            std = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
            z = (mean - mean.max()) / std
            improvement = std * (z * norm.cdf(z) + norm.pdf(z))
            improvement[chosen] = -np.inf
            nxt = int(np.argmax(improvement))
            trials = self.task.adaptation.trials_per_iteration
            noise = np.array([self.task.adaptation.trial_std**2 / trials])
            mean, covariance = _condition(mean, covariance, np.array([nxt], dtype=np.intp), mean[[nxt]], noise)
            chosen.append(nxt)
        return tuple(Particle(self.reward_table.candidates[i][None]) for i in chosen)


def _condition(
    mean: Array, covariance: Array, at: NDArray[np.intp], values: Array, noise: Array
) -> tuple[Array, Array]:
    """Rasmussen & Williams 2006, eq. 2.25 and 2.26, with the same E tried more than once allowed."""
    shared = covariance[:, at]
    gain = np.linalg.solve(covariance[np.ix_(at, at)] + np.diag(noise), shared.T).T
    return mean + gain @ (values - mean[at]), covariance - gain @ shared.T


def require(method: str, package: str, extra: str) -> None:
    """Raises ExtraMissing, with the line that installs it, unless `package` is installed. Imports nothing."""
    if find_spec(package) is None:
        raise ExtraMissing(missing(method, package, extra))


@contextmanager
def calculating(seed: int) -> Iterator[None]:
    """A context manager: inside, torch draws from `seed` and computes on one thread, and the packages print nothing.

    So results are the same on every machine, and torch's generator is unchanged afterwards.
    """
    import torch  # noqa: PLC0415 - slow to load

    from sim.solvers.threads import one_thread  # noqa: PLC0415

    silent = redirect_stdout(StringIO())  # sbi reports training on stdout, which is for data
    with torch.random.fork_rng(devices=[]), one_thread(), warnings.catch_warnings(), silent:
        warnings.simplefilter("ignore")
        torch.manual_seed(seed)
        yield
