"""Least squares from several starts at once: Levenberg-Marquardt with differences for derivatives. Pure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hw.types import Array

STEPS = 40
_DIFFERENCE = 1e-6
_DAMPING, _EASIER, _HARDER = 1e-2, 0.2, 6.0


def descend(
    residuals: Callable[[Array], Array], starts: Array, bounds: tuple[Array, Array], steps: int = STEPS
) -> tuple[Array, Array]:
    """From `starts` (S, p) to points (S, p) with smaller sums of squared `residuals`, (N, p) -> (N, m); and these sums.

    No point leaves the box `bounds`, low and high (p,).
    """
    low, high = bounds
    points, damping = np.clip(starts, low, high), np.full(len(starts), _DAMPING)
    off = residuals(points)
    for _ in range(steps):
        slopes = _slopes(residuals, points, off, high)
        normal = slopes @ np.swapaxes(slopes, 1, 2)  # (S, p, p)
        diagonal = np.einsum("spp->sp", normal) + 1e-12
        damped = normal + (damping[:, None] * diagonal)[:, :, None] * np.eye(points.shape[1])
        step = np.linalg.solve(damped, -(slopes @ off[:, :, None]))[..., 0]
        moved = np.clip(points + step, low, high)
        left = residuals(moved)
        is_better = (left**2).sum(axis=1) < (off**2).sum(axis=1)
        points, off = np.where(is_better[:, None], moved, points), np.where(is_better[:, None], left, off)
        damping = np.clip(damping * np.where(is_better, _EASIER, _HARDER), 1e-12, 1e9)
    return points, np.asarray((off**2).sum(axis=1))


def curvature(residuals: Callable[[Array], Array], point: Array, bounds: tuple[Array, Array]) -> Array:
    """(p, p) half of the second derivative of the sum of squares at `point` (p,), by Gauss and Newton."""
    slopes = _slopes(residuals, point[None], residuals(point[None]), bounds[1])[0]
    return np.asarray(slopes @ slopes.T)


def _slopes(residuals: Callable[[Array], Array], points: Array, off: Array, high: Array) -> Array:
    """(S, p, m)"""
    s, p = points.shape
    ahead = np.where(points + _DIFFERENCE <= high, _DIFFERENCE, -_DIFFERENCE)  # (S, p)
    beside = points[:, None] + ahead[:, :, None] * np.eye(p)
    return np.asarray((residuals(beside.reshape(s * p, p)).reshape(s, p, -1) - off[:, None]) / ahead[:, :, None])
