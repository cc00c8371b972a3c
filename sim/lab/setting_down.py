"""The lab's stand-in for a person who sets the tool down by hand, with the accuracy of a hand."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hw.poses import pose
from hw.types import Array
from hw.workcell import ArmModel
from sim.errors import SimError
from sim.lab.world import World
from sim.panda.model import postures
from sim.panda.setting_down import HAND_M, SetDown
from sim.panda.tool import ToolCorrection

AIM_M, TURN_RAD = 0.01, 0.04
"""How exactly the person holds place and direction: one standard deviation along each axis, and of pitch and yaw."""
_Q7 = 61
_MARGIN_RAD = 0.03


def true_X_FT(world: World, designed: Array) -> Array:
    """(4, 4) the tool as it really sits in the flange."""
    pitch_rad = float(getattr(world.unmodelled, "pitch_bias_rad", 0.0))
    return np.asarray(ToolCorrection(pitch_rad=pitch_rad).X_FT(world.mount.true.X_FT(designed)))


def set_down_q_rad(
    where: SetDown, world: World, designed: Array, arm: ArmModel, near_rad: Array, rng: np.random.Generator
) -> Array:
    """(7,) reported joints with both corners on the true table, each off by an error of the hand.

    `designed` (4, 4) is the tool in the flange by its drawing. Raises SimError out of reach.
    """
    table, X_FT = world.mount.true.table, true_X_FT(world, designed)
    errors_m = HAND_M * (rng.standard_normal() + rng.standard_normal(2))
    low, high = where.pitches_rad
    pitch_rad = float(np.clip(where.pitch_rad + TURN_RAD * rng.standard_normal(), low + 0.02, high - 0.02))
    yaw_rad, xy_m = TURN_RAD * rng.standard_normal(), where.xy_m + AIM_M * rng.standard_normal(2)
    left, right = where.corners
    roll_rad = float((errors_m[0] - errors_m[1]) / np.linalg.norm(left.p_T_m - right.p_T_m))
    R = Rotation.from_euler("ZYX", [yaw_rad, pitch_rad, roll_rad]).as_matrix()
    middle = (left.p_T_m + right.p_T_m) / 2.0
    above = np.array([*xy_m, left.radius_m + errors_m.mean()])
    X_BT = table.X_BW @ pose(R, above - R @ middle)
    limits = arm.in_true_joints().limits
    q = postures(X_BT @ np.linalg.inv(X_FT), limits, _Q7)
    q = q[((q > limits.q_min_rad + _MARGIN_RAD) & (q < limits.q_max_rad - _MARGIN_RAD)).all(axis=1)]
    if not len(q):
        raise SimError(f"the tool cannot be set down at {where.name}: it lies outside the arm's reach")
    return np.asarray(arm.reported_rad(q[np.abs(q - arm.true_rad(near_rad)).max(axis=1).argmin()]))
