"""The simulated person in the touch check of a calibration: lays the board down and guides the tip.

Kinematics only, without forces. The tip is a pin in the gripper; the calibration does not know its length.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hw.joint_limits import LIMITS
from hw.types import Array
from sim.errors import SimError
from sim.lab.board import THICKNESS_M, HeldBoard
from sim.panda.inverse import postures

PLACE_M = (0.62, 0.0)
"""Approximate place of the board's centre, in the base."""
PLACE_STD_M, TURN_STD_RAD = 0.01, 0.05
AIM_STD_M = 3e-4
"""Accuracy of a guided tip at a corner, per axis, m."""
TIP_M = (0.002, -0.001, 0.165)
"""The tip in the flange: a slightly tilted pin in the closed fingers."""
LEAN_RAD = 0.5
NEAR_RAD = (0.0, 0.2, 0.0, -2.2, 0.0, 2.4, 0.785)
_LEAN_STD_RAD = 0.05
_LEAN_SHARES = (1.0, 0.7, 0.4, 0.0)
_AZIMUTHS_RAD = (0.0, np.pi, np.pi / 2, -np.pi / 2)  # towards the camera, away from it, left, right


def laid_board(board: HeldBoard, rng: np.random.Generator) -> Array:
    """(4, 4) X_BM of the board flat on the table, face up, upright in the view of the camera opposite the arm."""
    width, height = board.size_m
    upright = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # print's right: +Y, down: +X, into: -Z
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, TURN_STD_RAD * rng.standard_normal()]).as_matrix() @ upright
    middle = np.array([*(PLACE_M + PLACE_STD_M * rng.standard_normal(2)), THICKNESS_M])
    X[:3, 3] = middle - X[:3, :3] @ np.array([width / 2, height / 2, 0.0])
    return X


def touching_q_rad(p_B_m: Array, number: int, rng: np.random.Generator) -> Array:
    """(7,) true joints with the tip at `p_B_m` (3,), with the accuracy of a hand, tilted to the side of `number`.

    The tilt is smaller if the arm cannot reach, as a person would do it. Raises SimError if it cannot reach even
    upright.
    """
    lean = LEAN_RAD + _LEAN_STD_RAD * rng.standard_normal()
    azimuth = _AZIMUTHS_RAD[number % len(_AZIMUTHS_RAD)] + _LEAN_STD_RAD * rng.standard_normal()
    aimed_m = p_B_m + AIM_STD_M * rng.standard_normal(3)
    for share in _LEAN_SHARES:
        q = _within_limits(aimed_m, share * lean, azimuth)
        if len(q):
            return np.asarray(q[np.linalg.norm(q - NEAR_RAD, axis=1).argmin()])
    raise SimError(f"the tip cannot be guided to {np.round(p_B_m, 3)} m: the board lies outside the arm's reach")


def _within_limits(p_B_m: Array, lean_rad: float, azimuth_rad: float) -> Array:
    """(N, 7) joints, away from their limits, with the tip at that place and the hand at that tilt."""
    axis = np.array([-np.sin(azimuth_rad), np.cos(azimuth_rad), 0.0])
    X_BF = np.eye(4)
    X_BF[:3, :3] = Rotation.from_rotvec(lean_rad * axis).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    X_BF[:3, 3] = p_B_m - X_BF[:3, :3] @ np.array(TIP_M)
    limits = LIMITS["panda"]
    q = postures(X_BF, limits, 61)
    return np.asarray(q[((q > limits.q_min_rad + 0.05) & (q < limits.q_max_rad - 0.05)).all(axis=1)])
