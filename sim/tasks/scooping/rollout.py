"""One training rollout: the spatula driven directly, through springs as stiff as the arm's.

The rollout starts shortly before the edge reaches the piece (nothing happens before). After the motion it continues,
with the tool held still, until the piece rests or has left the blade (`perception.types.SETTLE_S`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hw.poses import translation
from hw.types import Array
from perception.types import BLADE_LENGTH_M, BLADE_WIDTH_M, SETTLE_S, ObjectTrack, Outcome, is_on_blade
from sim.tasks.hardware import SceneBodies
from sim.tasks.scooping.params import (
    NUISANCE,
    OBSERVATION,
    PARAMETERS,
    PIECE_DENSITY_KG_M3,
    REFERENCE_CONTEXT,
    ScoopingUnmodelled,
    time_step_s,
)
from sim.tasks.scooping.piece import piece_of, sink_m
from sim.tasks.scooping.plan import DURATION_S, edge_height_m, plan
from sim.tasks.shared.carriage import Compliance, Drive, drive_of
from sim.tasks.shared.readings import READ_EVERY_S, Course, Moment, Readings, object_in_tool_m, read, reading_before_s
from sim.types import ToolMotion

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import Frame

ARM = Compliance(
    p_TP_m=(-0.497, 0.266),
    stiffness=(3.0e4, 2.0e4, 1050.0),
    damping=(510.0, 2000.0, 14.3),
    mass_kg=2.0,
    p_PM_m=(0.233, -0.069),
    inertia_kg_m2=0.012,
)
"""A Franka under its default joint impedance, as the edge feels it while it touches the table: joint stiffness,
damping and inertia carried to the edge along planned scoops (tests/sim/panda/test_arm_compliance.py). Nearly all of the
yielding is a rotation about a point above and behind the blade, so an edge that is pushed up moves forward too."""

LEAD_S = 0.030
"""How long before the edge reaches the piece the rollout starts."""

SETTLING_S = 0.70
"""Time from which the tool almost rests; a piece that also rests is not simulated further."""

LATEST_S = DURATION_S + SETTLE_S
STILL_MOVING = f"still moving against the blade {LATEST_S:g} s after the start"
"""The flag of a piece that still moved when it was judged."""

_ASIDE_M = 0.02


def rest_pose(context: Array, parameters: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None) -> Array:
    """(4, 4) pose X_BO of the piece at rest on the table with its near side at `context`, before the trial."""
    piece = piece_of(parameters, nuisance, unmodelled)
    mass_kg = PIECE_DENSITY_KG_M3 * piece.volume_m3 * (1.0 if unmodelled is None else unmodelled.density_scale)
    ahead_m = _half_width_m(nuisance, unmodelled)
    p = PARAMETERS.named(parameters)
    height_m = p.h / 200.0 - sink_m(piece, mass_kg, p.e)
    return translation([context[0] + ahead_m, context[1], height_m])


def piece_mass_kg(parameters: Array, nuisance: Array, unmodelled: ScoopingUnmodelled) -> float:
    """The mass of a piece with the density of training."""
    return PIECE_DENSITY_KG_M3 * piece_of(parameters, nuisance, unmodelled).volume_m3


def _half_width_m(nuisance: Array, unmodelled: ScoopingUnmodelled | None) -> float:
    """Distance of the piece's near side from its centre."""
    return float(NUISANCE.named(nuisance).radius) * (unmodelled or ScoopingUnmodelled()).semi_axis_scale[0]


def simulate(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None = None
) -> ObjectTrack:
    """Scoop once (see `sim.tasks.task.Simulate`)."""
    motion, X_BO = plan(context, action), rest_pose(context, parameters, nuisance, unmodelled)
    return track_of(readings(motion, X_BO, parameters, nuisance, unmodelled), motion)


def build_scene(
    plant: MultibodyPlant,
    tool_parent: Frame,
    X_PT: Array,
    parameters: Array,
    nuisance: Array,
    unmodelled: ScoopingUnmodelled | None,
) -> SceneBodies:
    """See `sim.tasks.hardware.BuildScene`."""
    from sim.tasks.scooping import scene  # noqa: PLC0415 - Drake is slow to import, and tasks are named without it

    return scene.build_scene(plant, tool_parent, X_PT, parameters, nuisance, unmodelled)


def readings(
    motion: ToolMotion, X_BO: Array, parameters: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None
) -> Readings:
    """The readings of the motion against a piece at X_BO (4, 4)."""
    from sim.tasks.shared.direct import Drake  # noqa: PLC0415 - slow to import, and tasks are named without

    course = course_of(motion, X_BO, nuisance, unmodelled)
    return read(Drake(course, build_scene, time_step_s(unmodelled), parameters, nuisance, unmodelled), course)


def course_of(motion: ToolMotion, X_BO: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None) -> Course:
    """The drive of the spatula against a piece at X_BO (4, 4), with start and end."""
    drive = drive_of(motion, ARM)
    start_s = _start_s(motion, float(X_BO[0, 3]), nuisance, unmodelled)
    return Course(drive, start_s, X_BO, _on_table(drive, start_s), _still, _off_blade, LATEST_S)


def _start_s(motion: ToolMotion, x_m: float, nuisance: Array, unmodelled: ScoopingUnmodelled | None) -> float:
    """A time shortly before the edge reaches the piece, on the grid of readings."""
    side_m, late_m = x_m - _half_width_m(nuisance, unmodelled), (unmodelled or ScoopingUnmodelled()).distance_bias_m
    reached = motion.X_BT[:, 0, 3] - late_m >= side_m
    touch_s = float(motion.t_s[reached][0]) if reached.any() else 0.0
    return reading_before_s(touch_s - LEAD_S)


def _on_table(drive: Drive, t_s: float) -> Array:
    """(6,) the carriage's state along the motion, except that the table holds the edge up and the springs yield."""
    start, arm = np.array(drive.trajectory.value(t_s)[:, 0]), drive.compliance
    height_m, rate_m_s = arm.tool_height(start)
    pitch_rad = float(start[2])
    missing_m = float(edge_height_m(start[2:3])[0]) - height_m
    if missing_m >= 0.0:
        yielding = arm.yielding(pitch_rad) / arm.lift_m_N(pitch_rad)
        start += np.concatenate([yielding * missing_m, -yielding * rate_m_s])
    return start


def _still(now: Moment) -> bool:
    """Whether the tool almost rests, and the piece rests on it or on the table."""
    return now.t_s >= SETTLING_S and (now.is_still_on_tool or now.is_still_on_table)


def _off_blade(now: Moment) -> bool:
    """Whether the piece has left the blade for good, after the last observed moment."""
    if now.t_s < DURATION_S:
        return False
    x_m, y_m, z_m = object_in_tool_m(now.X_BT, now.X_BO)
    beside_m = max(x_m, -BLADE_LENGTH_M - x_m, abs(y_m) - BLADE_WIDTH_M / 2)
    return bool(z_m < 0.0 or beside_m > _ASIDE_M)


def track_of(readings: Readings, motion: ToolMotion) -> ObjectTrack:
    """The track from the readings. Before the first reading the piece is held; after the last one it moves with the
    table or tool on which it lies.
    """
    t_s, p_BO_m, p_TO_m = readings.t_s, readings.p_BO_m, readings.p_TO_m
    outcome = Outcome.SOLVER_FAILED if readings.failure else _outcome(p_BO_m[-1], p_TO_m)
    if t_s[-1] < DURATION_S:
        later_s = np.append(np.arange(t_s[-1] + READ_EVERY_S, DURATION_S - 1e-9, READ_EVERY_S), DURATION_S)
        carried_m = _carried(motion, t_s[-1], later_s, p_BO_m[-1])
        on_blade = outcome is Outcome.ON_BLADE
        p_BO_m = np.concatenate([p_BO_m, carried_m if on_blade else np.tile(p_BO_m[-1], (len(later_s), 1))])
        t_s = np.concatenate([t_s, later_s])
    if t_s[0] > 0.0:
        t_s, p_BO_m = np.concatenate([[0.0], t_s]), np.concatenate([p_BO_m[:1], p_BO_m])
    flags = () if readings.is_settled else (readings.failure or STILL_MOVING,)
    return ObjectTrack(t_s, p_BO_m, outcome, p_TO_m, np.ones(len(t_s)), flags)


def _carried(motion: ToolMotion, from_s: float, to_s: Array, p_B_m: Array) -> Array:
    """(M, 3) place of a point that moves with the tool from `from_s` until each of `to_s`."""
    indices = np.searchsorted(motion.t_s, np.append(to_s, from_s) - 1e-9)
    X_BT = motion.X_BT[np.minimum(indices, len(motion.t_s) - 1)]
    p_T = np.linalg.inv(X_BT[-1]) @ np.append(p_B_m, 1.0)
    carried: Array = (X_BT[:-1] @ p_T)[:, :3]
    return carried


def _outcome(p_BO_m: Array, p_TO_m: Array) -> Outcome:
    if is_on_blade(p_TO_m):
        return Outcome.ON_BLADE
    return Outcome.ON_TABLE if p_BO_m[2] > 0.0 else Outcome.LOST


_FAR_M = 0.05
_FAR_COST = 0.2


def succeeded(track: ObjectTrack) -> bool:
    """The piece ended on the blade: over 1 mm above its face and inside its outline, or held by the neck."""
    return track.outcome is Outcome.ON_BLADE


def end_state(track: ObjectTrack) -> Array:
    """(2,) final place of the piece on the blade: (x, y) in the tool frame, m."""
    return np.array(track.end_in_tool_m[:2])


def reward_of_success(end_in_tool_m: Array, context: Array) -> Array:
    """1 - 0.2 min(1, distance from the blade's centre / 5 cm), for (..., 2) -> (...); from the public code."""
    distance_m = np.hypot(end_in_tool_m[..., 0] + BLADE_LENGTH_M / 2, end_in_tool_m[..., 1])
    return 1.0 - _FAR_COST * np.minimum(1.0, distance_m / _FAR_M)


def relocate(observation: Array, context: Array) -> Array:
    """The observation (..., size) at the reference context, moved to `context` (..., 2): the motion starts relative to
    the piece and the table is uniform, so everything moves along.
    """
    states = OBSERVATION.denormalise(observation)
    return OBSERVATION.normalise(states + (context - REFERENCE_CONTEXT)[..., None, :])
