"""One training rollout: the plate driven directly against the bottle, until the bottle rests.

It starts shortly before the plate touches (nothing happens before) and ends once the bottle rests out of the plate's
reach, has fallen, or has left the table. A fallen bottle counts as staying where it fell.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hw.types import Array
from perception.types import SETTLE_S, ObjectTrack, Outcome
from sim.tasks.hardware import SceneBodies
from sim.tasks.pushing.bottle import on_table, rest_pose
from sim.tasks.pushing.params import BOTTLE_RADIUS_M, GOAL_SCALE_M, TIPPED_RAD, PushingUnmodelled, goal_m, time_step_s
from sim.tasks.pushing.plan import plan
from sim.tasks.shared.carriage import Compliance, drive_of
from sim.tasks.shared.readings import Course, Moment, Readings, read, reading_before_s
from sim.types import ToolMotion

if TYPE_CHECKING:
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import Frame

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
"""It is stiffer than an arm and has no coupling, because a bottle of 0.3 kg moves the plate only by micrometres in both
cases (tests/sim/lab/test_lab_agreement.py)."""

STILL_MOVING = f"the bottle is still moving {SETTLE_S:g} s after the push"
"""The flag of a bottle that still moved when it was judged."""

_NEAR_M = 0.002


def simulate(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: PushingUnmodelled | None = None
) -> ObjectTrack:
    """Push once (see `sim.tasks.task.Simulate`)."""
    X_BO = rest_pose(context, parameters, nuisance, unmodelled)
    return track_of(readings(plan(context, action), X_BO, parameters, nuisance, unmodelled))


def build_scene(
    plant: MultibodyPlant,
    tool_parent: Frame,
    X_PT: Array,
    parameters: Array,
    nuisance: Array,
    unmodelled: PushingUnmodelled | None,
) -> SceneBodies:
    """See `sim.tasks.hardware.BuildScene`."""
    from sim.tasks.pushing import scene  # noqa: PLC0415 - Drake is slow to import, and tasks are named without it

    return scene.build_scene(plant, tool_parent, X_PT, parameters, nuisance, unmodelled)


def readings(
    motion: ToolMotion, X_BO: Array, parameters: Array, nuisance: Array, unmodelled: PushingUnmodelled | None
) -> Readings:
    """The readings of the motion against a bottle at X_BO (4, 4)."""
    from sim.tasks.shared.direct import Drake  # noqa: PLC0415 - slow to import, and tasks are named without

    course = course_of(motion, X_BO, nuisance, unmodelled)
    return read(Drake(course, build_scene, time_step_s(unmodelled), parameters, nuisance, unmodelled), course)


def course_of(motion: ToolMotion, X_BO: Array, nuisance: Array, unmodelled: PushingUnmodelled | None) -> Course:
    """The drive of the plate against a bottle at X_BO (4, 4), with start and end. Only this part of the motion is
    simulated.
    """
    drive = drive_of(motion, ARM)
    start_s = _start_s(motion, X_BO[:3, 3])
    latest_s = float(motion.t_s[-1]) + SETTLE_S
    tool = drive.trajectory.value(start_s)[:, 0]
    return Course(drive, start_s, X_BO, tool, partial(_still, motion), _has_fallen, latest_s)


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


def succeeded(track: ObjectTrack) -> bool:
    """The bottle rests upright on the table, at any distance from the goal."""
    return track.outcome is Outcome.UPRIGHT


def end_state(track: ObjectTrack) -> Array:
    """(2,) final place of the bottle: (x, y) in the base frame, m."""
    return np.array(track.state[-1, :2])


def reward_of_success(end_m: Array, context: Array) -> Array:
    """max(0, 1 - distance from the goal / 0.2 m), for (..., 2) and (..., 2) -> (...)."""
    distance_m = np.linalg.norm(end_m - goal_m(context), axis=-1)
    return np.asarray(np.maximum(0.0, 1.0 - distance_m / GOAL_SCALE_M))


def relocate(observation: Array, context: Array) -> Array:
    """The observation (..., size) itself: it does not depend on the goal."""
    return np.array(
        np.broadcast_to(
            observation, (*np.broadcast_shapes(observation.shape[:-1], context.shape[:-1]), observation.shape[-1])
        )
    )
