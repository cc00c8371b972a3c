"""Rigid poses."""

from __future__ import annotations

import numpy as np

from hw.types import Array


def inverse(X: Array) -> Array:
    """(..., 4, 4) rigid poses -> their inverses."""
    out = np.zeros_like(X)
    Rt = np.swapaxes(X[..., :3, :3], -1, -2)
    out[..., :3, :3] = Rt
    out[..., :3, 3] = -(Rt @ X[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out
