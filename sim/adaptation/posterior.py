"""The posterior of the simulation parameters from a session's trajectories, and the rewards of policies under it.

For display only: no method decides with it. It needs only the checkpoint's simulator, so it can be computed again for
any stored session.

It weighs parameter vectors that follow the prior. Sharp trajectories would leave all weight on the nearest vector, and
the grid would decide the interval. So vectors are added where the weight is (`sim.adaptation.refining`; for an exact
simulator `sim.adaptation.exact_fit`). If that does not resolve the likelihood, it is tempered (raised to a power below
1) until `RESOLVED` vectors carry the weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.densities import unit_points
from sim.adaptation.exact_fit import exact_fit, is_exact
from sim.adaptation.method import ExpectedTrajectories, Iteration, Simulating
from sim.adaptation.refining import refined
from sim.adaptation.trajectory_likelihood import TrajectoryLikelihood
from sim.errors import CollapsedPosterior
from sim.solvers.grid import grid_behind
from sim.tasks.task import Expectations, SolvedPolicy
from sim.types import Estimate, Space

RESOLVED = 24.0
"""Least effective number of samples behind a posterior."""

DRAWN, GENERATIONS = 256, 4
"""Number of vectors in a generation that refines a posterior, and the most generations."""

LEAST_EFFECTIVE = 10.0
"""Least number of effective samples for an interval, because a grid of fewer vectors than `RESOLVED` cannot be
tempered."""

COLLAPSED = "collapsed onto one sample: not an interval"
"""Shown instead of an interval."""

_HALVINGS = 40

TARGETS, CONTEXTS = 128, 8
"""Numbers of parameter draws and of contexts for the expected reward of a policy."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted parameter vectors: the probability that each is the true one, given the trajectories.

    Fewer than `LEAST_EFFECTIVE` of them give no interval (`is_collapsed`).

    `space` contains the parameters with the margin around their ranges, where the truth is searched.
    """

    space: Space
    samples: Array  # (T, p) in units
    weights: Array  # (T,) that sum to 1

    def __post_init__(self) -> None:
        samples = frozen_array(self.samples, (None, len(self.space)), "samples")
        weights = frozen_array(self.weights, (len(samples),), "weights")
        if (weights < 0.0).any() or not np.isclose(weights.sum(), 1.0):
            raise ValueError("the weights of a posterior are not negative and sum to 1")
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "weights", weights)

    @property
    def mean(self) -> Array:
        """(p,) in units; for a parameter on a logarithmic scale, the mean of its logarithm."""
        return self.space.denormalise(self.space.normalise(self.samples).T @ self.weights)

    @cached_property
    def effective(self) -> float:
        """The effective number of different samples (Kish). If it is the number of all samples, nothing is known; if it
        is 1, one sample has all the weight.
        """
        return _effective(self.weights, _groups(self.samples))

    @property
    def is_collapsed(self) -> bool:
        """Whether too few samples carry the weight for an interval."""
        return self.effective < LEAST_EFFECTIVE

    def quantiles(self, levels: Sequence[float]) -> Array:
        """(len(levels), p) in units, parameter by parameter. Levels lie in [0, 1].

        Raises CollapsedPosterior if `is_collapsed`.
        """
        if self.is_collapsed:
            raise CollapsedPosterior(f"the posterior is {COLLAPSED} ({self.effective:.1f} effective samples)")
        if not all(0.0 <= level <= 1.0 for level in levels):
            raise ValueError(f"levels {list(levels)}: each lies in [0, 1]")
        columns = zip(self.samples.T, self._order.T, strict=True)
        return np.stack([_quantiles(column[order], self.weights[order], levels) for column, order in columns], axis=-1)

    def chances(self, index: int) -> tuple[float, ...] | None:
        """The probability of each word of a parameter; None if it is a number, or if `is_collapsed`."""
        d = self.space.dimensions[index]
        return d.shares(self.samples[:, index], self.weights) if d.kinds and not self.is_collapsed else None

    @cached_property
    def _order(self) -> NDArray[np.intp]:
        return np.argsort(self.samples, axis=0)

    def table(self, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> list[dict[str, str | float]]:
        """The quantiles of each parameter with its unit, as rows of a data frame. Raises CollapsedPosterior."""
        ends = self.quantiles(levels)
        return [
            {
                "parameter": d.name,
                "unit": d.unit,
                "mean": float(mean),
                **{f"q{level:g}": float(value) for level, value in zip(levels, column, strict=True)},
            }
            for d, mean, column in zip(self.space.dimensions, self.mean, ends.T, strict=True)
        ]

    def draw(self, n: int, seed: int | np.random.Generator = 0) -> Array:
        """(n, p) in units, drawn with these weights; the same for the same seed."""
        rng = np.random.default_rng(seed)
        return np.asarray(self.samples[rng.choice(len(self.samples), size=n, p=self.weights)])


def likelihood_of(checkpoint: Checkpoint) -> TrajectoryLikelihood:
    """The likelihood behind every posterior of a checkpoint. Raises CheckpointError without a reward table."""
    table = reward_table_of("the posterior", checkpoint.solver.task, checkpoint)
    return TrajectoryLikelihood(checkpoint.solver, table.truths, table.prior)


def posterior(likelihood: TrajectoryLikelihood | Simulating, history: Sequence[Iteration]) -> Posterior:
    """The posterior after all trials of `history`; without any, the prior."""
    return posterior_after_each(likelihood, history)[-1]


def posterior_after_each(
    likelihood: TrajectoryLikelihood | Simulating, history: Sequence[Iteration]
) -> tuple[Posterior, ...]:
    """The prior, and the posterior after each iteration of `history`."""
    if isinstance(likelihood, Simulating):
        return tuple(
            Posterior(likelihood.solver.task.margin, drawn, np.full(len(drawn), 1.0 / len(drawn)))
            for drawn in likelihood.draws_after_each(history)
        )
    logs = likelihood.after_each(history)
    return tuple(_posterior(likelihood, history[:k], log) for k, log in enumerate(logs))


def _posterior(likelihood: TrajectoryLikelihood, history: Sequence[Iteration], log: Array) -> Posterior:
    """The posterior after `history`, whose trajectories have the log-likelihoods `log` (T,) of its truths."""
    space, truths = likelihood.expectations.task.margin, likelihood.truths
    trials, groups = [t for iteration in history for entry in iteration for t in entry.trials], _groups(truths)
    is_grid, prior = grid_behind(likelihood.expectations) is not None, likelihood.prior
    if trials and is_exact(likelihood.expectations):
        fit = exact_fit(likelihood.expectations, trials, truths, prior)
        return _resolved(space, fit.parameters, fit.weights)
    if not trials or is_grid or _effective(_tempered(log, groups, least=0.0), groups) >= RESOLVED:
        return Posterior(space, truths, _tempered(log, groups))

    def log_likelihoods(points: Array) -> Array:
        parameters = space.spread(points)
        return np.asarray(np.sum([likelihood.of(trial, parameters) for trial in trials], axis=0))

    finer = refined(log_likelihoods, unit_points(space, truths), log, prior, DRAWN, GENERATIONS)
    return _resolved(space, space.spread(np.clip(finer.points, 0.0, 1.0)), finer.weights)


def _resolved(space: Space, samples: Array, weights: Array) -> Posterior:
    """The posterior of weighted samples, tempered if too few of them carry the weight."""
    with np.errstate(divide="ignore"):
        return Posterior(space, samples, _tempered(np.log(weights), np.arange(len(samples))))


def predicted(expectations: ExpectedTrajectories, parameters: Array, context: Array, action: Array) -> Array:
    """(N, M, k) expected states, in units, of trials for parameters (N, p), at the times of the task's observation.

    The trials have contexts (N, c) and actions (N, a), or one context (c,) and action (a,) for all.
    Nuisance and action error are in the middle of their ranges; no camera noise.
    """
    task, n = expectations.task, len(parameters)
    middle = task.nuisance.denormalise(np.full((n, len(task.nuisance)), 0.5))
    contexts, actions = np.broadcast_to(context, (n, len(task.context))), np.broadcast_to(action, (n, len(task.action)))
    return task.observation.denormalise(expectations.trajectories(parameters, actions, middle, contexts))


def expected_reward(
    checkpoint: Checkpoint, after: Posterior, policies: Sequence[SolvedPolicy], rng: np.random.Generator
) -> Estimate:
    """The reward of `policies` if the true parameters follow `after`, averaged over policies, contexts, nuisance and
    action error; the interval is that of the posterior.
    """
    solver = checkpoint.solver
    targets, contexts = after.draw(TARGETS, rng), solver.task.context.sample(rng, CONTEXTS)
    drawn = int(rng.integers(2**31))
    rewards = np.mean([_earned(solver, targets, contexts, policy, drawn) for policy in policies], axis=0)
    low, high = np.quantile(rewards, (0.025, 0.975))
    return Estimate(float(rewards.mean()), float(low), float(high))


def _earned(expectations: Expectations, targets: Array, contexts: Array, policy: SolvedPolicy, seed: int) -> Array:
    actions = np.tile(policy.actions(contexts)[None], (len(targets), 1, 1))
    return expectations.expected_rewards(targets, contexts, actions, np.random.default_rng(seed))


def _groups(samples: Array) -> NDArray[np.intp]:
    """(T,) the index of each sample among the different ones."""
    return np.asarray(np.unique(samples, axis=0, return_inverse=True)[1], dtype=np.intp).reshape(-1)


def _effective(weights: Array, groups: NDArray[np.intp]) -> float:
    return float(1.0 / np.sum(np.bincount(groups, weights=weights) ** 2))


def _tempered(log: Array, groups: NDArray[np.intp], least: float = RESOLVED) -> Array:
    """(T,) weights: likelihoods to the largest power up to 1 that leaves `least` effective samples."""

    def weights(power: float) -> Array:
        likely = np.exp(power * (log - log.max()))
        return np.asarray(likely / likely.sum())

    if _effective(weights(1.0), groups) >= least:
        return weights(1.0)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _effective(weights(middle), groups) >= least else (low, middle)
    return weights(low)


def _quantiles(values: Array, weights: Array, levels: Sequence[float]) -> Array:
    """The smallest of the sorted values up to which a share of the weight lies, for each level."""
    reached = np.cumsum(weights)
    at = np.searchsorted(reached, np.asarray(levels) * reached[-1] - 1e-12)
    return np.asarray(values[np.minimum(at, len(values) - 1)])
