"""Inverse kinematics of the Panda and the FR3 in closed form, with joint 7 as the redundant one.

Joints 5 and 6 meet in the wrist W and joints 1, 2 and 3 in the shoulder S. Flange pose and joint 7 fix W; the
triangle S, elbow, W fixes joint 4; the direction of the forearm then follows from one equation in joint 6, and the
rest from the frames themselves. Two signs remain (side of the wrist, side of the shoulder), which gives four branches.
Joint 4 takes the branch that folds the elbow within its limits.

The derivation is ours, from the maker's table in `hw.kinematics`; He and Liu (2021) describe the same family.
"""

from __future__ import annotations

import numpy as np

from hw.joint_limits import JointLimits
from hw.kinematics import A4_M, A7_M, D1_M, D3_M, D5_M, FLANGE_M
from hw.types import Array

BRANCHES = 4

_SHOULDER = np.array([0.0, 0.0, D1_M])
_CENTRE = np.array([0.0, 0.0, 0.0, -np.pi / 2, 0.0, 1.9, 0.0])  # angles lie within half a turn of these
_UPPER2, _FORE2 = A4_M**2 + D3_M**2, A4_M**2 + D5_M**2
_COS4, _SIN4 = A4_M**2 - D3_M * D5_M, A4_M * (D3_M + D5_M)


def inverse(X_BF: Array, q7_rad: Array) -> Array:
    """Flange poses (..., 4, 4) and joint 7 (...) -> (..., 4, 7) joint positions, one row per branch.

    The leading axes broadcast. An unreachable branch is NaN. Position limits are not checked, but every angle is given
    in the turn that contains its range. A branch followed along a path is continuous.
    """
    R, p = X_BF[..., :3, :3], X_BF[..., :3, 3]
    c7, s7 = np.cos(q7_rad)[..., None], np.sin(q7_rad)[..., None]
    x6 = c7 * R[..., :, 0] - s7 * R[..., :, 1]
    y6 = np.broadcast_to(-R[..., :, 2], x6.shape)
    to_shoulder = _SHOULDER - (p - FLANGE_M * R[..., :, 2] - A7_M * x6)  # from the wrist
    with np.errstate(invalid="ignore"):
        q4 = _elbow(np.einsum("...i,...i->...", to_shoulder, to_shoulder))
        q6 = _wrist(q4, _dot(to_shoulder, x6), _dot(to_shoulder, y6))  # (..., 2)
    q4 = np.broadcast_to(q4[..., None], q6.shape)
    c4, s4, c6, s6 = (v[..., None] for v in (np.cos(q4), np.sin(q4), np.cos(q6), np.sin(q6)))
    x6, y6, to_shoulder = x6[..., None, :], y6[..., None, :], to_shoulder[..., None, :]

    x5, y4 = c6 * x6 - s6 * y6, s6 * x6 + c6 * y6  # frame 5: its Z axis is the Y axis of frame 4
    x4 = (to_shoulder - _along_y4(c4, s4) * y4) / (A4_M * (1.0 - c4) - D3_M * s4)
    z4 = np.cross(x4, y4)
    q5 = np.arctan2(-_dot(x5, z4), _dot(x5, x4))
    x3, z3 = c4 * x4 - s4 * y4, s4 * x4 + c4 * y4

    side = np.array([1.0, -1.0])
    q1 = np.arctan2(side * z3[..., 1, None], side * z3[..., 0, None])  # (..., 2, 2): wrist side, shoulder side
    q2 = np.arctan2(side * np.hypot(z3[..., 0], z3[..., 1])[..., None], z3[..., 2, None])
    c1, s1, c2, s2 = np.cos(q1), np.sin(q1), np.cos(q2), np.sin(q2)
    x2 = np.stack([c2 * c1, c2 * s1, -s2], axis=-1)
    z2 = np.stack([-s1, c1, np.zeros_like(c1)], axis=-1)
    q3 = np.arctan2(_dot(x3[..., None, :], z2), _dot(x3[..., None, :], x2))

    shape = q3.shape
    both = [np.broadcast_to(v[..., None], shape) for v in (q4, q5, q6)]
    q7 = np.broadcast_to(np.asarray(q7_rad, dtype=np.float64)[..., None, None], shape)
    q = np.stack([q1, q2, q3, *both, q7], axis=-1).reshape(*shape[:-2], BRANCHES, 7)
    q[..., :6] = _CENTRE[:6] + _wrap(q[..., :6] - _CENTRE[:6])
    return q


def postures(X_BF: Array, limits: JointLimits, count: int, ratio: float = np.inf) -> Array:
    """(N, 7) all postures with the flange at one of the poses (..., 4, 4), over `count` - 2 positions of joint 7.

    `ratio` is the largest allowed share of a joint's position limits.
    """
    q7 = np.linspace(limits.q_min_rad[6], limits.q_max_rad[6], count)[1:-1]
    q = inverse(X_BF[..., None, :, :], q7).reshape(-1, 7)
    q = q[np.isfinite(q).all(axis=1)]
    still = np.zeros_like(q)
    return np.asarray(q[limits.ratios(q, still, still)[0].max(axis=1) <= ratio])


def _elbow(distance2: Array) -> Array:
    """Squared distance between shoulder and wrist -> joint 4 in (-3.61, -0.47), NaN out of reach."""
    cosine = (_UPPER2 + _FORE2 - distance2) / 2.0 / np.hypot(_COS4, _SIN4)
    return np.asarray(np.arctan2(_SIN4, _COS4) + np.arccos(cosine) - 2.0 * np.pi)


def _wrist(q4: Array, along_x6: Array, along_y6: Array) -> Array:
    """The two joints 6 (..., 2) for which the forearm makes the right angle with the line to the shoulder."""
    wanted = _along_y4(np.cos(q4), np.sin(q4))
    spread = np.arccos(wanted / np.hypot(along_x6, along_y6))
    middle = np.arctan2(along_x6, along_y6)
    return np.stack([middle - spread, middle + spread], axis=-1)


def _along_y4(c4: Array, s4: Array) -> Array:
    """Component of the line from wrist to shoulder along the forearm (Y axis of frame 4)."""
    return -D5_M + A4_M * s4 - D3_M * c4


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _wrap(angle: Array) -> Array:
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))
