"""The way home with an object on the tool, along a line with a steady rotation, so gentle that nothing rolls off.

On a straight line in joint space the tool rolls by up to 13°, and one scooped piece in three is lost
(docs/decisions/0003).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation, Slerp

from hw.kinematics import forward, jacobian
from hw.types import Array, JointPath, frozen_array
from hw.workcell import ArmModel
from sim.errors import NotExecutable
from sim.panda.moves import PEAK_ACCELERATION, time_curve

GENTLE_M_S2 = 0.15
"""Largest acceleration of the tool on the way: a round piece stays at the root of a blade that is tilted back by 1°."""

_KNOTS = 61
_ITERATIONS = 20
_CONVERGED_RAD = 1e-8
_SINGULAR = 1e-4
_SHORTEST_S = 0.5


def carry_path(q_from_rad: ArrayLike, q_to_rad: ArrayLike, X_FT: Array, arm: ArmModel) -> JointPath:
    """The path between two postures (7,); the tool, at X_FT (4, 4) in the flange, moves straight and rotates steadily.

    At every moment the posture is the one, among those with that tool pose, nearest to the straight line in joint
    space. Raises NotExecutable if there is no such path, or it comes too near to a limit.
    """
    q_from, q_to = (arm.true_rad(frozen_array(q, (7,), "q_rad")) for q in (q_from_rad, q_to_rad))
    ends = np.stack([forward(q) @ X_FT for q in (q_from, q_to)])
    share = np.linspace(0.0, 1.0, _KNOTS)
    X_BT = np.tile(np.eye(4), (_KNOTS, 1, 1))
    X_BT[:, :3, :3] = Slerp([0.0, 1.0], Rotation.from_matrix(ends[:, :3, :3]))(share).as_matrix()
    X_BT[:, :3, 3] = ends[0, :3, 3] + share[:, None] * (ends[1, :3, 3] - ends[0, :3, 3])
    q_rad = _nearest(q_from + share[:, None] * (q_to - q_from), X_BT @ np.linalg.inv(X_FT))
    if q_rad is None:
        raise NotExecutable(
            f"{arm.name}: the straight way of the tool to the home posture leaves the arm's reach; choose another "
            "action"
        )
    along = make_interp_spline(share, q_rad, k=5)
    distance_m = float(np.linalg.norm(ends[1, :3, 3] - ends[0, :3, 3]))
    duration_s = max(_SHORTEST_S, math.sqrt(PEAK_ACCELERATION * distance_m / GENTLE_M_S2))
    return arm.reported(time_curve(along, duration_s, arm.in_true_joints().limits))


def _nearest(q_wanted: Array, X_BF: Array) -> Array | None:
    """(N, 7) postures with the flange at X_BF (N, 4, 4), nearest to `q_wanted` (N, 7); None if this does not converge.

    It is Newton's method on the pose, while the free direction moves towards the wanted posture.
    """
    q = np.array(q_wanted)
    for _ in range(_ITERATIONS):
        J = jacobian(q)
        onto = np.linalg.pinv(J, rcond=_SINGULAR)
        held = onto @ _apart(forward(q), X_BF)[..., None]
        free = (np.eye(7) - onto @ J) @ (q_wanted - q)[..., None]
        step = (free - held)[..., 0]
        q = q + step
        if np.abs(step).max() < _CONVERGED_RAD:
            return q
    return None


def _apart(X: Array, X_wanted: Array) -> Array:
    """(N, 6) differences of poses (N, 4, 4) from the wanted ones: position in m, then rotation in rad."""
    turn = X[..., :3, :3] @ X_wanted[..., :3, :3].swapaxes(-1, -2)
    turned = Rotation.from_matrix(turn).as_rotvec()
    return np.concatenate([X[..., :3, 3] - X_wanted[..., :3, 3], turned], axis=-1)
