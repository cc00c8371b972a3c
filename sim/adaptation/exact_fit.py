"""The parameters of an exact simulator that repeats the trials of a session, by least squares.

Such a simulator has no error of its own and its trials no noise, so the only uncertainty is the misfit of the best
parameters, which determines the width of the posterior. If the best parameters of the margin lie at its edge and still
miss, the search goes on in all physically possible values (`sim.types.Dimension.limits`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.densities import Kernels, Prior
from sim.adaptation.descent import curvature, descend
from sim.adaptation.method import Trial
from sim.adaptation.refining import WeightedPoints, refined
from sim.rollouts.draws import repeats_exactly
from sim.solvers.grid import grid_behind
from sim.solvers.misfit import log_likelihood, observed_share, offsets
from sim.tasks.task import Expectations

STARTS = 8
"""Number of starts of a search, the best points of the cloud."""

LEAST_LEFT = 0.01
"""Least misfit that counts, in units of the tolerated deviation of a trajectory; less is rounding."""

AT_EDGE = 1e-3
"""A fit lies at the edge of the margin if its distance from the edge is below this share of the margin."""

DRAWN, GENERATIONS = 256, 4


@dataclass(frozen=True, eq=False)
class ExactFit:
    """The posterior of the parameters, around the best fit."""

    parameters: Array  # (N, p) in units
    weights: Array  # (N,) that sum to 1
    log_prior: Array  # (N,) of the prior over the density that proposed them
    left: float  # misfit that is left, between LEAST_LEFT and 1


def is_exact(expectations: Expectations) -> bool:
    """Whether nothing but the parameters separates a trial from its prediction, which changes with every parameter."""
    if not repeats_exactly(expectations.task) or grid_behind(expectations) is not None:
        return False
    return not np.any(expectations.residual_std)


def exact_fit(expectations: Expectations, trials: Sequence[Trial], cloud: Array, prior: Prior) -> ExactFit:
    """The fit to one trial or more; `cloud` (T, p), in units, follows the prior."""
    space = expectations.task.margin
    unit = space.normalise(cloud)
    low, high = prior.low, prior.high
    count = len(trials)

    def residuals(points: Array) -> Array:
        parts = [_offsets(expectations, trial, space.denormalise(points)) for trial in trials]
        return np.asarray(np.concatenate(parts, axis=1) / count**0.5)

    starts = unit[np.argsort((residuals(unit) ** 2).sum(axis=1), kind="stable")[:STARTS]]
    points, left = descend(residuals, starts, (low, high))
    best = points[int(left.argmin())]
    is_at_edge = bool((np.minimum(best - low, high - best) < AT_EDGE).any())
    if is_at_edge and left.min() > LEAST_LEFT**2:
        low, high = (space.normalise(end) for end in space.physical)
        points, left = descend(residuals, np.concatenate([points, starts]), (low, high))
        best = points[int(left.argmin())]
        prior = prior.within(low, high)
        unit = prior.cloud(len(unit))
    misfit = float(np.clip(left.min() ** 0.5, LEAST_LEFT, 1.0))

    def log_likelihoods(points: Array) -> Array:
        parameters = space.denormalise(points)
        squared = [(_offsets(expectations, trial, parameters) ** 2).sum(axis=1) for trial in trials]
        shares = [observed_share(trial.observation) for trial in trials]
        terms = (log_likelihood(s[:, None] / misfit**2, share) for s, share in zip(squared, shares, strict=True))
        return np.asarray(np.sum(list(terms), axis=0))

    around = np.linalg.inv(3.0 * count * curvature(residuals, best, (low, high)) / misfit**2 + 12.0 * np.eye(len(best)))
    first = Kernels(best[None], np.linalg.cholesky(around))
    fit: WeightedPoints = refined(log_likelihoods, unit, log_likelihoods(unit), prior, DRAWN, GENERATIONS, first)
    return ExactFit(space.denormalise(fit.points), fit.weights, fit.log_prior, misfit)


def _offsets(expectations: Expectations, trial: Trial, parameters: Array) -> Array:
    """(N, observed) whose squares sum to the mean squared distance."""
    action = np.broadcast_to(trial.action, (len(parameters), len(trial.action)))
    nothing = np.zeros((len(parameters), len(expectations.task.nuisance)))
    contexts = np.broadcast_to(trial.context, (len(parameters), len(trial.context)))
    paths = expectations.trajectories(parameters, action, nothing, contexts)
    off = offsets(expectations, trial.observation, paths)
    return np.asarray(off / max(off.shape[1], 1) ** 0.5)
