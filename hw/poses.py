"""Rigid poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hw.types import Array


def pose(R: ArrayLike, p_m: ArrayLike) -> Array:
    """(4, 4) from a rotation (3, 3) and a position (3,)."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p_m
    return X


def translation(p_m: ArrayLike) -> Array:
    """(4, 4) without rotation, at a position (3,)."""
    return pose(np.eye(3), p_m)


def inverse(X: Array) -> Array:
    """(..., 4, 4) rigid poses -> their inverses."""
    out = np.zeros_like(X)
    Rt = np.swapaxes(X[..., :3, :3], -1, -2)
    out[..., :3, :3] = Rt
    out[..., :3, 3] = -(Rt @ X[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out
