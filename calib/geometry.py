"""Small motions of rigid poses, vectorised over the leading axes. A twist is (rotation rad, translation m)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hw.poses import inverse
from hw.types import Array


def cross_matrix(v: Array) -> Array:
    """(..., 3) -> (..., 3, 3), so that cross_matrix(a) @ b is the cross product."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def rotation_vector(R: Array) -> Array:
    """(..., 3, 3) -> (..., 3) in rad."""
    turned: Array = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return turned.reshape(*R.shape[:-2], 3)


def pose(R: Array, p: ArrayLike) -> Array:
    """Rotations (..., 3, 3) and positions (..., 3) -> poses (..., 4, 4)."""
    X = np.zeros((*R.shape[:-2], 4, 4))
    X[..., :3, :3], X[..., :3, 3], X[..., 3, 3] = R, p, 1.0
    return X


def move(X: Array, twist: Array) -> Array:
    """(..., 4, 4) poses moved by twists (..., 6) in their own axes: X (R(w), v)."""
    step = np.zeros((*twist.shape[:-1], 4, 4))
    step[..., :3, :3] = Rotation.from_rotvec(twist[..., :3].reshape(-1, 3)).as_matrix().reshape(*twist.shape[:-1], 3, 3)
    step[..., :3, 3] = twist[..., 3:]
    step[..., 3, 3] = 1.0
    moved: Array = X @ step
    return moved


def difference(X_from: Array, X_to: Array) -> Array:
    """(..., 6) twist from one pose to the other: `move(X_from, difference(X_from, X_to))` is X_to."""
    step = inverse(X_from) @ X_to
    return np.concatenate([rotation_vector(step[..., :3, :3]), step[..., :3, 3]], axis=-1)


def adjoint(X: Array) -> Array:
    """(..., 6, 6): a small twist in the axes of B, seen in A, for X_AB."""
    out = np.zeros((*X.shape[:-2], 6, 6))
    R = X[..., :3, :3]
    out[..., :3, :3] = R
    out[..., 3:, 3:] = R
    out[..., 3:, :3] = cross_matrix(X[..., :3, 3]) @ R
    return out


def angle_deg(X_a: Array, X_b: Array) -> float:
    """Angle between the rotations of two poses."""
    return float(np.rad2deg(np.linalg.norm(rotation_vector(X_a[:3, :3].T @ X_b[:3, :3]))))


def distance_mm(X_a: Array, X_b: Array) -> float:
    """Distance between the origins of two poses."""
    return float(1e3 * np.linalg.norm(X_a[:3, 3] - X_b[:3, 3]))


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
