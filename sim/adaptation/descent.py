"""Least squares by Levenberg and Marquardt, with finite differences. It runs from several starts at once, or with few
evaluations. Pure.
"""

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


FEW_STEPS = 3
_DAMPINGS = np.array([1e-2, 1.0])


def descend_with_few(
    residuals: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array], difference: float
) -> tuple[Array, float]:
    """The same from one start (p,), if an evaluation is a simulation. It takes p + 1 + 2 `FEW_STEPS` evaluations.

    Slopes are measured once, over `difference`; Broyden's update (1965, Math. Comp. 19) follows each step. Each step
    tries two dampings, which may be simulated side by side.
    """
    (low, high), point = bounds, np.clip(start, *bounds)
    off = residuals(point[None])[0]
    slopes = _slopes(residuals, point[None], off[None], high, difference)[0]
    for _ in range(FEW_STEPS):
        normal = slopes @ slopes.T
        damped = normal + _DAMPINGS[:, None, None] * np.diag(normal.diagonal() + 1e-12)
        moved = np.clip(point - np.linalg.solve(damped, (slopes @ off)[None, :, None])[..., 0], low, high)
        left = residuals(moved)
        nearest = int((left**2).sum(axis=1).argmin())
        step, change = moved[nearest] - point, left[nearest] - off
        if (length := float(step @ step)) == 0.0:
            break
        slopes = slopes + np.outer(step, change - step @ slopes) / length
        if (left[nearest] ** 2).sum() < (off**2).sum():
            point, off = moved[nearest], left[nearest]
    return point, float((off**2).sum())


def curvature(
    residuals: Callable[[Array], Array],
    point: Array,
    bounds: tuple[Array, Array],
    difference: float = _DIFFERENCE,
) -> Array:
    """(p, p) half of the second derivative of the sum of squares at `point` (p,), by Gauss and Newton."""
    slopes = _slopes(residuals, point[None], residuals(point[None]), bounds[1], difference)[0]
    return np.asarray(slopes @ slopes.T)


def _slopes(
    residuals: Callable[[Array], Array], points: Array, off: Array, high: Array, difference: float = _DIFFERENCE
) -> Array:
    """(S, p, m)"""
    s, p = points.shape
    ahead = np.where(points + difference <= high, difference, -difference)  # (S, p)
    beside = points[:, None] + ahead[:, :, None] * np.eye(p)
    return np.asarray((residuals(beside.reshape(s * p, p)).reshape(s, p, -1) - off[:, None]) / ahead[:, :, None])
