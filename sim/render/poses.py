"""Poses inside one exposure."""

from __future__ import annotations

import numpy as np

from hw.types import Array

STILL = 5e-6
"""Tolerance in m, and in rad over 0.2 m: 1/300 of a pixel of the lab's camera."""


def held_still(X: Array) -> Array:
    """Poses (S, 4, 4) over time -> the same, but a pose within `STILL` of an earlier one becomes that one.

    A body at rest moves by nanometres; a renderer needs only one picture of a body that does not move.
    """
    held = X.copy()
    for i in range(1, len(held)):
        if np.abs(held[i] - held[i - 1]).max() <= STILL:
            held[i] = held[i - 1]
    return held


def holds_still(X: Array) -> bool:
    """Whether poses (S, 4, 4) are all the same."""
    return not np.ptp(X, axis=0).any()


def within_exposure(X: Array, fractions: Array) -> Array:
    """Poses (S, 4, 4) at the middles of S equal slices of an exposure -> (K, 4, 4) at `fractions` (K,) in [0, 1].

    Linear interpolation (rotations are orthonormalised), held beyond the first and last slice. A body that holds still
    is not interpolated: its poses stay exactly equal.
    """
    if holds_still(X):
        X = X[:1]
    count = len(X)
    place = np.clip(fractions * count - 0.5, 0, count - 1)
    lower = np.minimum(place.astype(int), max(count - 2, 0))
    upper = np.minimum(lower + 1, count - 1)
    weight = (place - lower)[:, None, None]
    mixed: Array = (1 - weight) * X[lower] + weight * X[upper]
    u, _, vt = np.linalg.svd(mixed[:, :3, :3])
    mixed[:, :3, :3] = u @ vt
    return mixed
