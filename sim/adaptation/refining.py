"""Weighted points where the likelihood is, instead of a fixed cloud: adaptive importance sampling. Pure.

A cloud that fills the ranges evenly has no point near the truth once trials are sharp. So new points are drawn around
the best ones, generation by generation: the likelihood is tempered until `RESOLVED` points carry the weight, and their
kernel density proposes the next points. All points of all generations keep their weight: likelihood times prior over
the density of all proposals together (deterministic mixture; Cornuet et al. 2012, "Adaptive multiple importance
sampling", Scand. J. Stat. 39). It ends when the untempered likelihood is resolved. The same input gives the same
points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from hw.types import Array

RESOLVED = 32.0
"""Effective number of points that carry a resolved likelihood."""

CENTRES = 64
"""Number of kernels of a proposal."""

_HALVINGS = 40
_NARROWEST = 1e-9  # least variance of a proposal, in squared fractions of the box

LogLikelihood = Callable[[Array], Array]
"""(N, p) points of the box -> (N,)"""


@dataclass(frozen=True, eq=False)
class WeightedPoints:
    """Points with the weights of their posterior."""

    points: Array  # (N, p)
    weights: Array  # (N,) that sum to 1
    log_prior: Array  # (N,) of the prior over the density that proposed them; -inf outside


@dataclass(frozen=True, eq=False)
class Proposal:
    """A density to draw points from: equal normal kernels."""

    centres: Array  # (K, p)
    factor: Array  # (p, p) lower Cholesky factor of a kernel's covariance

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """(n, p)"""
        shape = (n, self.centres.shape[1])
        return np.asarray(self.centres[np.arange(n) % len(self.centres)] + rng.standard_normal(shape) @ self.factor.T)

    def log_density(self, points: Array) -> Array:
        """(N, p) -> (N,)"""
        p = self.centres.shape[1]
        at, centres = (np.linalg.solve(self.factor, one.T).T for one in (points, self.centres))
        squared = (at**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * at @ centres.T
        volume = np.log(self.factor.diagonal()).sum() + 0.5 * p * np.log(2.0 * np.pi) + np.log(len(centres))
        return np.asarray(logsumexp(-0.5 * np.maximum(squared, 0.0), axis=1) - volume)


def refined(
    log_likelihood: LogLikelihood,
    cloud: Array,
    cloud_log: Array,
    bounds: tuple[Array, Array],
    drawn: int,
    most: int,
    first: Proposal | None = None,
) -> WeightedPoints:
    """The posterior of a uniform prior on the box `bounds`, low and high (p,).

    `cloud` (T, p) fills the box evenly and has the log-likelihoods `cloud_log` (T,). At most `most` generations of
    `drawn` points follow; `first` proposes those of the first one.
    """
    rng, (low, high) = np.random.default_rng(0), bounds
    points, log, proposals = cloud, cloud_log, list[Proposal]()
    uniform = -np.log(high - low).sum()
    while True:
        mixed = _log_mixture(points, uniform, len(cloud), proposals, drawn)
        is_inside = ((points >= low) & (points <= high)).all(axis=1)
        prior = np.where(is_inside, uniform - mixed, -np.inf)
        weights = _weights(prior + log)
        is_resolved = 1.0 / (weights**2).sum() >= RESOLVED and (first is None or proposals)
        if len(proposals) == most or is_resolved:
            return WeightedPoints(points, weights, prior)
        if first is not None and not proposals:
            proposals.append(first)
        else:
            proposals.append(_around(points, _tempered(prior, log), rng))
        fresh = np.clip(proposals[-1].draw(drawn, rng), low - (high - low), high + (high - low))
        within = np.clip(fresh, low, high)
        new = np.where((fresh == within).all(axis=1), log_likelihood(within), -np.inf)
        points, log = np.concatenate([points, fresh]), np.concatenate([log, new])


def systematic(weights: Array, n: int) -> Array:
    """(n,) indices drawn in proportion to weights (N,), evenly."""
    places = (np.arange(n) + 0.5) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)


def _around(points: Array, weights: Array, rng: np.random.Generator) -> Proposal:
    """The kernel density of weighted points, with the bandwidth of Scott's rule for their effective number."""
    p, effective = points.shape[1], 1.0 / (weights**2).sum()
    apart = points - weights @ points
    covariance = (apart * weights[:, None]).T @ apart + _NARROWEST * np.eye(p)
    factor = np.linalg.cholesky(covariance) * effective ** (-1.0 / (p + 4))
    return Proposal(points[systematic(weights, CENTRES)], factor)


def _log_mixture(points: Array, uniform: float, cloud: int, proposals: list[Proposal], drawn: int) -> Array:
    """(N,) log density of all proposals together, the cloud's uniform one included."""
    parts = [np.full(len(points), uniform + np.log(cloud))]
    parts += [one.log_density(points) + np.log(drawn) for one in proposals]
    return np.asarray(logsumexp(parts, axis=0) - np.log(cloud + drawn * len(proposals)))


def _tempered(prior: Array, log: Array) -> Array:
    """(N,) weights by the largest power of the likelihood up to 1 that leaves `RESOLVED` effective points."""
    low, high = 0.0, 1.0
    finite = np.where(np.isfinite(log), log, -1e300)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_wide = 1.0 / (_weights(prior + middle * finite) ** 2).sum() >= RESOLVED
        low, high = (middle, high) if is_wide else (low, middle)
    return _weights(prior + low * finite)


def _weights(log: Array) -> Array:
    likely = np.exp(log - log.max())
    return np.asarray(likely / likely.sum())
