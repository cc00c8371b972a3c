"""Densities of parameters, in fractions of the margin: the prior of a session, and kernels around weighted points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hw.types import Array
from sim.rollouts.draws import sobol
from sim.types import Space

CENTRES = 64
"""Number of kernels around weighted points."""

UNSURE = 0.1
"""Share of the uniform prior that stays when a session begins with the posterior of another: its object may differ."""

ANOTHER_STD = 0.02
"""Standard deviation of the parameters of another object or table of the same kind, as a share of the margin. It is our
choice: for the next session no posterior is sharper, however exact it is for its own."""

_NARROWEST = 1e-9  # least variance of a kernel, in squared fractions of the box
_TRIED = 256  # draws of each kernel, to find those inside of the box


@dataclass(frozen=True, eq=False)
class Kernels:
    """Equal normal kernels."""

    centres: Array  # (K, p)
    factor: Array  # (p, p) lower Cholesky factor of a kernel's covariance

    @classmethod
    def around(cls, points: Array, weights: Array, least_std: float = 0.0) -> Kernels:
        """The kernel density of weighted points (N, p), (N,), with the bandwidth of Scott's rule for their effective
        number; a kernel's standard deviation is at least `least_std` in every direction.
        """
        p, effective = points.shape[1], 1.0 / (weights**2).sum()
        apart = points - weights @ points
        covariance = (apart * weights[:, None]).T @ apart + _NARROWEST * np.eye(p)
        scott = effective ** (-1.0 / (p + 4))
        factor = np.linalg.cholesky(covariance) * scott
        if least_std > 0.0:
            factor = np.linalg.cholesky(factor @ factor.T + least_std**2 * np.eye(p))
        return cls(points[systematic(weights, CENTRES)], factor)

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """(n, p)"""
        shape = (n, self.centres.shape[1])
        return np.asarray(self.centres[np.arange(n) % len(self.centres)] + rng.standard_normal(shape) @ self.factor.T)

    def log_density(self, points: Array) -> Array:
        """(N, p) -> (N,)"""
        from scipy.special import logsumexp  # noqa: PLC0415 - slow to import, and a list of checkpoints needs none

        p = self.centres.shape[1]
        at, centres = (np.linalg.solve(self.factor, one.T).T for one in (points, self.centres))
        squared = (at**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * at @ centres.T
        volume = np.log(self.factor.diagonal()).sum() + 0.5 * p * np.log(2.0 * np.pi) + np.log(len(centres))
        return np.asarray(logsumexp(-0.5 * np.maximum(squared, 0.0), axis=1) - volume)


@dataclass(frozen=True, eq=False)
class Prior:
    """The density before the first trial: uniform in a box, or the posterior of another session.

    That posterior is kernels around its points, cut off at the box; the share `UNSURE` stays uniform.
    """

    low: Array  # (p,) lower ends of the box
    high: Array  # (p,) upper ends
    kernels: Kernels | None = None  # None: uniform

    @classmethod
    def uniform(cls, p: int) -> Prior:
        """On the margin of `p` parameters."""
        return cls(np.zeros(p), np.ones(p))

    @classmethod
    def after(cls, points: Array, weights: Array, physical: tuple[Array, Array]) -> Prior:
        """Around the posterior of another session, (N, p) and (N,).

        Its box is the margin, or `physical`, low and high (p,), if that posterior lies beyond the margin.
        """
        p = points.shape[1]
        shown = points[weights > 0.0]
        is_beyond = (shown < 0.0).any() or (shown > 1.0).any()
        low, high = physical if is_beyond else (np.zeros(p), np.ones(p))
        return cls(low, high, Kernels.around(points, weights, ANOTHER_STD))

    def within(self, low: Array, high: Array) -> Prior:
        """The same prior in another box."""
        return replace(self, low=low, high=high)

    def log_density(self, points: Array) -> Array:
        """(N, p) -> (N,); -inf outside of the box."""
        is_inside = ((points >= self.low) & (points <= self.high)).all(axis=1)
        uniform = np.where(is_inside, -np.log(self.high - self.low).sum(), -np.inf)
        if self.kernels is None:
            return uniform
        _, share = self._drawn
        around = np.where(is_inside, self.kernels.log_density(points) - np.log(share), -np.inf)
        return np.asarray(np.logaddexp(np.log(UNSURE) + uniform, np.log1p(-UNSURE) + around))

    def cloud(self, n: int) -> Array:
        """(n, p) points with this density, in an order without a trend. The uniform part is even, and the points are
        always the same.
        """
        rng = np.random.default_rng(0)
        near = 0 if self.kernels is None else round(n * (1.0 - UNSURE))
        even = self.low + sobol(n - near, len(self.low), rng) * (self.high - self.low)
        if not near:
            return even
        drawn, _ = self._drawn
        around = rng.choice(drawn, near, replace=len(drawn) < near)
        return rng.permutation(np.concatenate([around, even]))

    @cached_property
    def _drawn(self) -> tuple[Array, float]:
        """Draws of the kernels inside of the box, and their share of all draws."""
        assert self.kernels is not None
        drawn = self.kernels.draw(_TRIED * CENTRES, np.random.default_rng(0))
        inside = drawn[((drawn >= self.low) & (drawn <= self.high)).all(axis=1)]
        return inside, len(inside) / len(drawn)


def unit_points(space: Space, values: Array) -> Array:
    """The inverse of `Space.spread` for points (T, p) in units: points that fill `space` evenly fill the unit box
    evenly.
    """
    return space.unspread(values, np.random.default_rng(0).random(values.shape))


def systematic(weights: Array, n: int) -> Array:
    """(n,) indices drawn in proportion to weights (N,), evenly."""
    places = (np.arange(n) + 0.5) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)


def weights_of(log: Array) -> Array:
    """(N,) weights that sum to 1, from their logarithms (N,) up to a constant."""
    likely = np.exp(log - log.max())
    return np.asarray(likely / likely.sum())
