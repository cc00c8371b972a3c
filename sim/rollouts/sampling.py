"""Space-filling draws: the same numbers for the same seed, whatever the machine."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import qmc

from hw.types import Array
from sim.types import Space


def sobol(n: int, dimensions: int, rng: np.random.Generator) -> Array:
    """(n, dimensions) scrambled Sobol points in [0, 1); from the same generator state, more of them extend fewer."""
    if dimensions == 0:
        return np.zeros((n, 0))
    engine = qmc.Sobol(dimensions, scramble=True, rng=rng)
    return np.asarray(engine.random_base2(max(0, math.ceil(math.log2(max(n, 1)))))[:n], dtype=np.float64)


def spread(space: Space, unit: Array) -> Array:
    """(..., n) in [0, 1) -> (..., n) in units; whole numbers get equal shares, both ends included."""
    value = space.denormalise(unit)
    whole = np.array([d.scale == "integer" for d in space.dimensions], dtype=bool)
    levels = np.floor(space.low + unit * (space.high - space.low + 1.0))
    return np.where(whole, np.minimum(levels, space.high), value)
