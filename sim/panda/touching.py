"""The slow motions of a touch-off: the posture of each probe, and the straight way down that a guard may stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hw.collision import Table
from hw.contact import predicted_force_N
from hw.kinematics import forward
from hw.poses import pose
from hw.types import PATH_RATE_HZ, Array, ContactWindow, Guard, JointPath, frozen_array
from hw.workcell import ArmModel, Workcell, check_guarded
from sim.errors import NotExecutable
from sim.panda.model import inverse, postures
from sim.panda.redundancy import ALLOWED
from sim.panda.tool import FINGERTIPS, Feeler

RAMP_S = 0.4
STILL_S = 0.25
"""Rest before the way down, so that the tare contains no acceleration."""
CALM_RAD_S2 = 1.5
"""Largest acceleration of a joint on the way down.

Close to a singular posture a slow tool needs fast joints, and the torque to accelerate them feels like a touch: 5.7
rad/s² gave 5 N.
"""
_Q7 = 91
_EVERY, _MOST = 3, 24
"""Step through the postures for a place, nearest first, and the largest number to try."""


@dataclass(frozen=True, eq=False)
class Probe:
    """One touch: feeler, place on the table, and orientation of the tool."""

    name: str
    feeler: Feeler
    xy_m: Array  # (2,) place of the feeler, in the table's frame
    R_WT: Array  # (3, 3) orientation of the tool

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", frozen_array(self.xy_m, (2,), "xy_m"))
        object.__setattr__(self, "R_WT", frozen_array(self.R_WT, (3, 3), "R_WT"))

    def X_BT(self, table: Table, above_m: float) -> Array:
        """(4, 4) the tool with the feeler's lowest point `above_m` over the table."""
        centre = np.array([*self.xy_m, above_m + self.feeler.radius_m])
        X_WT = pose(self.R_WT, centre - self.R_WT @ self.feeler.p_T_m)
        return np.asarray(table.X_BW @ X_WT)


@dataclass(frozen=True)
class Stage:
    """One stage of a way down."""

    way_m: float
    speed_m_s: float


@dataclass(frozen=True, eq=False)
class HeldTool:
    """Arm, tool and surroundings for a plan."""

    cell: Workcell
    X_FT: Array  # (4, 4) the tool by present knowledge; for empty fingers the identity

    def guard(self, feeler: Feeler, force_N: float) -> Guard:
        """A guard with `force_N` at the centre of the feeler."""
        return Guard(force_N, self.X_FT[:3, :3] @ feeler.p_T_m + self.X_FT[:3, 3])


def stance(
    probe: Probe,
    bench: HeldTool,
    table: Table,
    above_m: float,
    search: Sequence[Stage],
    force_N: float,
    q_near: ArrayLike,
) -> Array:
    """(7,) the posture nearest to `q_near` with the feeler `above_m` over the table, from which `search` keeps the
    limits.

    Raises NotExecutable with the reason against the best one.
    """
    arm, cell = bench.cell.arm, bench.cell.over(table)
    limits, near = arm.in_true_joints().limits, arm.true_rad(frozen_array(q_near, (7,), "q_near"))
    q = postures(probe.X_BT(table, above_m) @ np.linalg.inv(bench.X_FT), limits, _Q7, ALLOWED)
    guard = bench.guard(probe.feeler, force_N)
    refused = "it is outside the arm's reach"
    for candidate in q[np.argsort(np.abs(q - near).max(axis=1))][::_EVERY][:_MOST]:
        try:
            path = descent(arm.reported_rad(candidate), search, guard, 0.0, arm)
        except NotExecutable as error:
            refused = str(error)
            continue
        turning_rad_s2 = float(np.abs(np.diff(path.q_rad, 2, axis=0)).max()) * PATH_RATE_HZ**2
        if turning_rad_s2 > CALM_RAD_S2:
            refused = f"a joint would have to speed up by {turning_rad_s2:.1f} rad/s², {CALM_RAD_S2:g} are allowed"
            continue
        report = check_guarded(path, guard, cell)
        if report.ok:
            return frozen_array(arm.reported_rad(candidate))
        refused = str(report.worst)
    raise NotExecutable(f"{arm.name}: the arm cannot touch at {probe.name}: {refused}; choose another place")


def descent(q_top_rad: ArrayLike, stages: Sequence[Stage], guard: Guard, below_m: float, arm: ArmModel) -> JointPath:
    """Straight down from `q_top_rad` (7,), joint 7 and the tool's attitude held, through the `stages` in turn.

    The whole way is a contact window that declares `below_m` (its depth below the expected table) and the largest
    expected force. Raises NotExecutable out of reach.
    """
    q_top = arm.true_rad(frozen_array(q_top_rad, (7,), "q_top_rad"))
    way_m = _steady(stages)
    X_BF = np.repeat(forward(q_top)[None], len(way_m), axis=0)
    X_BF[:, 2, 3] -= way_m
    branch = int(np.nan_to_num(np.abs(inverse(X_BF[0], q_top[6]) - q_top).max(axis=-1), nan=np.inf).argmin())
    q_rad = inverse(X_BF, np.full(len(way_m), q_top[6]))[:, branch]
    if not np.isfinite(q_rad).all():
        raise NotExecutable(
            f"{arm.name}: the arm cannot come down by {1e3 * way_m[-1]:.0f} mm there; choose another place"
        )
    force_N = predicted_force_N(guard, max(stage.speed_m_s for stage in stages))
    t_s = np.arange(len(way_m)) / PATH_RATE_HZ
    window = ContactWindow(0.0, float(t_s[-1]), max(below_m, 0.0), force_N)
    return arm.reported(JointPath(t_s, q_rad, window))


def _steady(stages: Sequence[Stage]) -> Array:
    """(N,) distance at 1 kHz: constant speeds with smooth changes between them (fifth order), at rest at both ends.

    The change to the next speed belongs to the previous stage.
    """
    speeds = [0.0, *(stage.speed_m_s for stage in stages), 0.0]
    ramp = np.arange(round(RAMP_S * PATH_RATE_HZ)) / (RAMP_S * PATH_RATE_HZ)
    share = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    parts = [np.zeros(round(STILL_S * PATH_RATE_HZ)), share * speeds[1]]
    for i, stage in enumerate(stages, start=1):
        changes_m = RAMP_S / 2.0 * (stage.speed_m_s + speeds[i + 1] + (speeds[1] if i == 1 else 0.0))
        steady_s = max(stage.way_m - changes_m, 0.0) / stage.speed_m_s
        parts.append(np.full(round(steady_s * PATH_RATE_HZ), stage.speed_m_s))
        parts.append(speeds[i] + share * (speeds[i + 1] - speeds[i]))
    return np.concatenate([[0.0], np.cumsum(np.concatenate(parts)) / PATH_RATE_HZ])


AROUND_M = ((-0.10, -0.16), (-0.10, 0.16), (0.06, 0.16), (0.06, -0.16), (-0.02, 0.0))
"""Places of the table around the work area's centre, along X and Y."""
PITCHES_DEG = (5.0, 18.0)
"""One pitch near that of the task, for the height, and one that shows the corner's place along the blade."""
ROLL_DEG = 3.0
"""Roll to one side: one corner is 4 mm lower than the other, over 80 mm."""

_STRAIGHT_DOWN = np.diag([1.0, -1.0, -1.0])


def table_probes(centre_m: ArrayLike) -> tuple[Probe, ...]:
    """Probes with the closed fingers straight down, around `centre_m` (2,)."""
    centre = np.asarray(centre_m, dtype=np.float64)
    return tuple(
        Probe(f"table place {i}", FINGERTIPS, centre + np.array(off), _STRAIGHT_DOWN)
        for i, off in enumerate(AROUND_M, start=1)
    )


def tool_probes(feelers: Sequence[Feeler], centre_m: ArrayLike) -> tuple[Probe, ...]:
    """Every corner of the tool at every pitch: front corners pitched down, rear corners up, each rolled to its own
    side.
    """
    middle_x = float(np.mean([f.p_T_m[0] for f in feelers]))
    return tuple(
        Probe(f"{f.name} at {pitch:g}°", f, np.asarray(centre_m, dtype=np.float64), _held(f, pitch, middle_x))
        for pitch in PITCHES_DEG
        for f in feelers
    )


def _held(feeler: Feeler, pitch_deg: float, middle_x: float) -> Array:
    x_m, y_m, _ = feeler.p_T_m
    turns = [pitch_deg if x_m >= middle_x else -pitch_deg, -ROLL_DEG if y_m > 0.0 else ROLL_DEG]
    return np.asarray(Rotation.from_euler("YX", turns, degrees=True).as_matrix())
