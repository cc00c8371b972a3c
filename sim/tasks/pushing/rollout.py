"""One training rollout: the plate driven directly against the bottle, until the bottle rests.

It starts shortly before the plate touches (nothing happens before) and ends once the bottle rests out of the plate's
reach, has fallen, or has left the table. A fallen bottle counts as staying where it fell.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from pydrake.math import RigidTransform

from hw.types import Array
from perception.types import SETTLE_S, ObjectTrack, Outcome
from sim.tasks.pushing.params import BOTTLE_MASS_KG, BOTTLE_RADIUS_M, TIPPED_RAD, Unmodelled
from sim.tasks.pushing.plan import plan
from sim.tasks.pushing.rest import rest_pose
from sim.tasks.pushing.scene import build_scene, time_step_s
from sim.tasks.pushing.table import on_table
from sim.tasks.shared.carriage import Compliance, drive_of
from sim.tasks.shared.direct import run
from sim.tasks.shared.readings import Course, Ending, Moment, Readings, Start, reading_before_s
from sim.types import ToolMotion

LEAD_S = 0.020
"""The rollout starts at least this long (s) before the plate touches."""

ARM = Compliance(
    p_TP_m=(0.0, 0.0),
    stiffness=(2e4, 4000.0, 400.0),
    damping=(2.0 * math.sqrt(2e4), 130.0, 4.0),
    mass_kg=1.0,
    p_PM_m=(0.0, 0.0),
    inertia_kg_m2=0.01,
)
"""Stiffer than an arm and without its coupling: a bottle of 0.3 kg moves the plate by micrometres either way
(tests/sim/lab/test_lab_agreement.py)."""

STILL_MOVING = f"the bottle is still moving {SETTLE_S:g} s after the push"
"""The flag of a bottle that still moved when it was judged."""

_NEAR_M = 0.002


def simulate(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Unmodelled | None = None
) -> ObjectTrack:
    """Push once (see `sim.tasks.task.Simulate`)."""
    X_BO = rest_pose(context, parameters, nuisance, unmodelled)
    return play(plan(context, action), X_BO, parameters, nuisance, unmodelled)


def play(
    motion: ToolMotion, X_BO: Array, parameters: Array, nuisance: Array, unmodelled: Unmodelled | None
) -> ObjectTrack:
    """Play the motion against a bottle at X_BO (4, 4)."""
    return track_of(readings(motion, X_BO, parameters, nuisance, unmodelled))


def readings(
    motion: ToolMotion, X_BO: Array, parameters: Array, nuisance: Array, unmodelled: Unmodelled | None
) -> Readings:
    """The readings of the motion against a bottle at X_BO (4, 4)."""
    build = partial(build_scene, X_PT=np.eye(4), parameters=parameters, nuisance=nuisance, unmodelled=unmodelled)
    return run(course_of(motion, X_BO, nuisance, unmodelled), build, time_step_s(unmodelled))


def course_of(motion: ToolMotion, X_BO: Array, nuisance: Array, unmodelled: Unmodelled | None) -> Course:
    """The drive of the plate against a bottle at X_BO (4, 4), with start and end; the rest does not enter."""
    drive = drive_of(motion, ARM)
    start_s = _start_s(motion, X_BO[:3, 3])
    start = Start(start_s, X_BO, drive.trajectory.value(start_s)[:, 0])
    return Course(drive, start, Ending(partial(_still, motion), _has_fallen, float(motion.t_s[-1]) + SETTLE_S))


def bottle_mass_kg(parameters: Array, nuisance: Array, unmodelled: Unmodelled) -> float:
    """What every bottle of training weighs."""
    return BOTTLE_MASS_KG


def _start_s(motion: ToolMotion, p_BO_m: Array) -> float:
    """A time shortly before the plate touches, on the grid of readings."""
    touching = _gap_m(motion.X_BT, p_BO_m) <= 0.0
    touch_s = float(motion.t_s[touching][0]) if touching.any() else float(motion.t_s[-1])
    return reading_before_s(touch_s - LEAD_S)


def _gap_m(X_BT: Array, p_BO_m: Array) -> Array:
    """(...) distance from the lower edge of the plate at (..., 4, 4) to an upright bottle, along the push."""
    left = X_BT[..., :2, 1]
    ahead = np.stack([left[..., 1], -left[..., 0]], axis=-1)
    gap_m: Array = ((p_BO_m[:2] - X_BT[..., :2, 3]) * ahead).sum(axis=-1) - BOTTLE_RADIUS_M
    return gap_m


def _has_fallen(now: Moment) -> bool:
    """Whether the bottle lies, or has left the table."""
    X_BO = now.X_BO
    return _lean_rad(X_BO) > TIPPED_RAD or not on_table(X_BO.translation()[:2])


def _still(motion: ToolMotion, now: Moment) -> bool:
    """Whether the bottle is still and out of the plate's further reach."""
    if not now.is_still_on_table:
        return False
    return now.t_s >= motion.t_s[-1] or float(_gap_m(motion.X_BT[-1], np.asarray(now.X_BO.translation()))) > _NEAR_M


def track_of(readings: Readings) -> ObjectTrack:
    """The readings, with the bottle at rest before them."""
    t_s, p_BO_m = readings.t_s, readings.p_BO_m
    if t_s[0] > 0.0:
        t_s, p_BO_m = np.concatenate([[0.0], t_s]), np.concatenate([p_BO_m[:1], p_BO_m])
    flags = () if readings.is_settled else (readings.failure or STILL_MOVING,)
    return ObjectTrack(t_s, p_BO_m, _outcome(readings), readings.p_TO_m, np.ones(len(t_s)), flags)


def _outcome(readings: Readings) -> Outcome:
    if readings.failure is not None:
        return Outcome.SOLVER_FAILED
    X_BO = readings.X_BO[-1]
    if not on_table(X_BO.translation()[:2]):
        return Outcome.LOST
    return Outcome.TIPPED if _lean_rad(X_BO) > TIPPED_RAD else Outcome.UPRIGHT


def _lean_rad(X_BO: RigidTransform) -> float:
    return math.acos(min(1.0, max(-1.0, float(X_BO.rotation().matrix()[2, 2]))))
