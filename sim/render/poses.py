"""Poses inside one exposure."""

from __future__ import annotations

import numpy as np

from hw.types import Array


def within_exposure(X: Array, fractions: Array) -> Array:
    """Poses (S, 4, 4) at the middles of S equal slices of an exposure -> (K, 4, 4) at `fractions` (K,) in [0, 1].

    Linear in between (rotations made proper again); held beyond the first and last slice.
    """
    count = len(X)
    place = np.clip(fractions * count - 0.5, 0, count - 1)
    lower = np.minimum(place.astype(int), max(count - 2, 0))
    upper = np.minimum(lower + 1, count - 1)
    weight = (place - lower)[:, None, None]
    mixed: Array = (1 - weight) * X[lower] + weight * X[upper]
    u, _, vt = np.linalg.svd(mixed[:, :3, :3])
    mixed[:, :3, :3] = u @ vt
    return mixed
