"""The one numpy model of the Franka Panda, the FR3 and the FR3 v2, which share their kinematics.

Source: the maker's Denavit-Hartenberg table in Craig's convention ("Robot and interface specifications").
Joint i rotates about the Z axis of frame i. Frame 0 is the base B. The flange F lies 0.107 m along the Z axis of frame
7, with the same orientation (the 45° of the hand belong to the hand).

Every function takes joint positions (..., 7) in rad and is vectorised over the leading axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hw.types import Array

JOINTS = 7
FLANGE = 8
"""Index of the flange in `link_poses`; 0 is the base and 1..7 are the links."""

D1_M, D3_M, D5_M, FLANGE_M = 0.333, 0.316, 0.384, 0.107
A4_M, A7_M = 0.0825, 0.088

# a_{i-1}, d_i in m, sine of alpha_{i-1} (the cosine is 1 if the sine is 0, else 0)
CRAIG = (
    (0.0, D1_M, 0),
    (0.0, 0.0, -1),
    (0.0, D3_M, 1),
    (A4_M, 0.0, 1),
    (-A4_M, D5_M, -1),
    (0.0, 0.0, 1),
    (A7_M, 0.0, 1),
)


def link_poses(q_rad: ArrayLike) -> Array:
    """(..., 7) -> (..., 9, 4, 4): base, links 1 to 7 and flange in the base frame."""
    q = np.asarray(q_rad, dtype=np.float64)
    if q.shape[-1:] != (JOINTS,):
        raise ValueError(f"joint positions have shape {q.shape}, expected (..., {JOINTS})")
    lead = q.shape[:-1]
    cos, sin = np.moveaxis(np.cos(q), -1, 0), np.moveaxis(np.sin(q), -1, 0)
    poses = np.zeros((FLANGE + 1, 4, 4, *lead))  # samples last: one matrix entry of all samples is contiguous
    poses[:, 3, 3] = 1.0
    for i in range(3):
        poses[0, i, i] = 1.0
    x, y, z, p = (poses[0, :3, column] for column in range(4))
    for i, (a, d, sine) in enumerate(CRAIG):
        if sine:
            y, z = sine * z, -sine * y
        p = p + a * x + d * z
        x, y = cos[i] * x + sin[i] * y, cos[i] * y - sin[i] * x
        for column, axis in enumerate((x, y, z, p)):
            poses[i + 1, :3, column] = axis
    poses[FLANGE, :3, :3] = poses[JOINTS, :3, :3]
    poses[FLANGE, :3, 3] = p + FLANGE_M * z
    return np.moveaxis(poses, (0, 1, 2), (-3, -2, -1))


def forward(q_rad: ArrayLike) -> Array:
    """(..., 7) -> X_BF (..., 4, 4): the flange in the base frame."""
    return np.ascontiguousarray(link_poses(q_rad)[..., FLANGE, :, :])


def jacobian(q_rad: ArrayLike, p_FT_m: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """(..., 7) -> (..., 6, 7) geometric Jacobian in base axes: linear velocity of the point, then angular velocity.

    The point `p_FT_m` (3,) is fixed in the flange; the default is the flange's origin.
    """
    poses = link_poses(q_rad)
    flange = poses[..., FLANGE, :, :]
    point = flange[..., :3, 3] + flange[..., :3, :3] @ np.asarray(p_FT_m, dtype=np.float64)
    axes, origins = poses[..., 1:FLANGE, :3, 2], poses[..., 1:FLANGE, :3, 3]
    linear = np.cross(axes, point[..., None, :] - origins)
    return np.moveaxis(np.concatenate([linear, axes], axis=-1), -1, -2)
