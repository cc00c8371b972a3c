"""Weighted points where the likelihood is, instead of a fixed cloud: adaptive importance sampling. Pure.

A cloud that fills the ranges evenly has no point near the truth once trials are sharp. So new points are drawn around
the best ones, generation by generation: the likelihood is tempered until `RESOLVED` points carry the weight, and their
kernel density proposes the next points. The points of all generations are kept. A point's weight is its likelihood
times its prior, divided by the density of all proposals together (deterministic mixture; Cornuet et al. 2012, "Adaptive
multiple importance sampling", Scand. J. Stat. 39). It ends when the untempered likelihood is resolved. The same input
gives the same points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from hw.types import Array
from sim.adaptation.densities import Kernels, Prior, weights_of

RESOLVED = 32.0
"""Effective number of points that carry a resolved likelihood."""

_HALVINGS = 40

LogLikelihood = Callable[[Array], Array]
"""(N, p) points of the box -> (N,)"""


@dataclass(frozen=True, eq=False)
class WeightedPoints:
    """Points with the weights of their posterior."""

    points: Array  # (N, p)
    weights: Array  # (N,) that sum to 1
    log_prior: Array  # (N,) of the prior over the density that proposed them; -inf outside


def refined(
    log_likelihood: LogLikelihood,
    cloud: Array,
    cloud_log: Array,
    prior: Prior,
    drawn: int,
    most: int,
    first: Kernels | None = None,
) -> WeightedPoints:
    """The posterior after `prior`.

    `cloud` (T, p) follows the prior and has the log-likelihoods `cloud_log` (T,). At most `most` generations of
    `drawn` points follow; `first` proposes those of the first one.
    """
    rng, low, high = np.random.default_rng(0), prior.low, prior.high
    points, log, proposals = cloud, cloud_log, list[Kernels]()
    while True:
        log_prior = _log_prior(points, prior, len(cloud), proposals, drawn)
        weights = weights_of(log_prior + log)
        is_resolved = 1.0 / (weights**2).sum() >= RESOLVED and (first is None or proposals)
        if len(proposals) == most or is_resolved:
            return WeightedPoints(points, weights, log_prior)
        if first is not None and not proposals:
            proposals.append(first)
        else:
            proposals.append(Kernels.around(points, _tempered(log_prior, log)))
        fresh = np.clip(proposals[-1].draw(drawn, rng), low - (high - low), high + (high - low))
        within = np.clip(fresh, low, high)
        new = np.where((fresh == within).all(axis=1), log_likelihood(within), -np.inf)
        points, log = np.concatenate([points, fresh]), np.concatenate([log, new])


def _log_prior(points: Array, prior: Prior, cloud: int, proposals: list[Kernels], drawn: int) -> Array:
    """(N,) log of the prior over the density of all proposals together; the cloud follows the prior."""
    density = prior.log_density(points)
    is_inside = np.isfinite(density)
    parts = [density + np.log(cloud), *(one.log_density(points) + np.log(drawn) for one in proposals)]
    mixed = logsumexp(np.array(parts)[:, is_inside], axis=0) - np.log(cloud + drawn * len(proposals))
    ratio = np.full(len(points), -np.inf)
    ratio[is_inside] = density[is_inside] - mixed
    return ratio


def _tempered(prior: Array, log: Array) -> Array:
    """(N,) weights by the largest power of the likelihood up to 1 that leaves `RESOLVED` effective points."""
    low, high = 0.0, 1.0
    finite = np.where(np.isfinite(log), log, -1e300)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_wide = 1.0 / (weights_of(prior + middle * finite) ** 2).sum() >= RESOLVED
        low, high = (middle, high) if is_wide else (low, middle)
    return weights_of(prior + low * finite)
