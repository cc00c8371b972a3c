"""How long and how far an arm still moves once somebody wants it to stop. All pages state this one worst case.

The chain, at its worst: the pedal falls silent and nobody hears it for `SILENCE_S`; the program's word reaches the
player after `HEARD_S`; a stop may begin up to `NEXT_STOP_S` later; the arm brakes along its path, and follows its
commands with a lag of up to `LAG_S`. Until the brake begins, every point moves on as planned. A released pedal, Ctrl-C,
a program that hangs and one that is killed are all heard sooner.

The reaction of a person comes before all this and is in none of these numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.braking import BEFORE_S, FULL, LAG_S, LONGEST_S, WORST_STOP_S, Braking, at_pace, check_braking
from hw.capsules import segments
from hw.collision import moving
from hw.joint_limits import DT_S
from hw.kinematics import FLANGE as FLANGE_FRAME
from hw.kinematics import link_poses
from hw.motion_limits import FLANGE
from hw.types import Array, JointPath
from hw.workcell import Workcell

REDUCED_M_S = 0.25
"""The reduced speed of ISO 10218-1: a slow motion keeps every point of arm and tool under it."""
TRAVEL_EVERY = 10
"""A measured travel is the sum of steps of 10 ms, so that the noise of measured joints does not add up."""
_KEPT = 0.99
"""Share of the reduced speed that a motion is slowed to, so that the rounding of its samples stays below it."""


@dataclass(frozen=True)
class WorstStop:
    """The worst stop, from the wish to stop to rest."""

    time_s: float
    distance_m: float  # travel of the point of arm or tool that goes farthest
    speed_m_s: float  # of the fastest point of arm and tool
    braking_s: float  # the part of `time_s` that the arm brakes
    point: str  # the body that goes farthest

    def __str__(self) -> str:
        return f"at most {self.time_s:.2f} s and {100.0 * self.distance_m:.0f} cm"


def worst_stop(cell: Workcell, paths: Sequence[JointPath] = (), pace: float = FULL) -> WorstStop:
    """The worst stop of `paths` (reported joints, at full pace), played at `pace` in `cell`.

    Without paths: a bound for every motion that the cell accepts, from the flange's limits, the tool's length and the
    longest stop. Raises ValueError for a pace out of range, MotionRefused if a path has a moment without a stop.
    """
    if not paths:
        speed_m_s, point = _bound_m_s(cell)
        return WorstStop(WORST_STOP_S, pace * speed_m_s * WORST_STOP_S, pace * speed_m_s, LONGEST_S, point)
    stops = [_of_path(cell, at_pace(path, pace)) for path in paths]
    farthest = max(stops, key=lambda stop: stop.distance_m)
    return WorstStop(
        max(stop.time_s for stop in stops),
        farthest.distance_m,
        max(stop.speed_m_s for stop in stops),
        max(stop.braking_s for stop in stops),
        farthest.point,
    )


def _of_path(cell: Workcell, path: JointPath) -> WorstStop:
    braking = check_braking(path, cell.motion)
    bodies = moving(cell.tool)
    speed_m_s = speeds_m_s(path, cell)
    distance_m = _travels_m(path, braking, speed_m_s)
    braking_s = float(np.max(braking.duration_s, where=np.isfinite(braking.duration_s), initial=0.0))
    farthest = int(distance_m.argmax())
    return WorstStop(
        BEFORE_S + braking_s + LAG_S,
        float(distance_m[farthest]),
        float(speed_m_s.max()),
        braking_s,
        bodies[farthest].name,
    )


def _travels_m(path: JointPath, braking: Braking, speed_m_s: Array) -> Array:
    """(C,) the largest travel of each body: unbraked until the stop begins, then along the braked path.

    A measured arm is behind its commands, so its remaining travel begins earlier by the lag.
    """
    way_m = np.concatenate([np.zeros((1, speed_m_s.shape[1])), np.cumsum(speed_m_s * DT_S, axis=0)])
    stops = np.isfinite(braking.duration_s)
    at_s, end_s = braking.at_s[stops], braking.path_time_s[stops, -1]
    last = len(way_m) - 1

    def row(t_s: Array) -> Array:
        return np.clip(np.rint(t_s / DT_S), 0, last).astype(int)

    return np.asarray((way_m[row(end_s)] - way_m[row(at_s - BEFORE_S - LAG_S)]).max(axis=0))


def speeds_m_s(path: JointPath, cell: Workcell) -> Array:
    """(N - 1, C) the speed of the fastest point of each body of arm and tool from one sample to the next.

    A point of a capsule is a point of its axis plus at most its radius: it moves at most as fast as the faster end of
    the axis, plus radius times turning speed.
    """
    return _steps_m(path.q_rad, cell) / DT_S


def travel_m(q_rad: Array, cell: Workcell) -> float:
    """The travel of the point of arm and tool that goes farthest, along reported joints (N, 7), one a millisecond."""
    steps = np.unique(np.append(np.arange(0, len(q_rad), TRAVEL_EVERY), len(q_rad) - 1))
    return float(_steps_m(q_rad[steps], cell).sum(axis=0).max())


def _steps_m(q_rad: Array, cell: Workcell) -> Array:
    """(N - 1, C) how far the farthest point of each body goes from one sample (N, 7) to the next."""
    poses = link_poses(cell.arm.true_rad(q_rad))
    bodies = moving(cell.tool)
    ends_m = np.linalg.norm(np.diff(segments(poses, bodies), axis=0), axis=-1).max(axis=-1)
    turned = np.linalg.norm(np.diff(poses[..., :3, :3], axis=0), axis=(-2, -1)) / np.sqrt(2.0)  # of a small angle
    radii = np.array([body.radius_m for body in bodies])
    return np.asarray(ends_m + radii * turned[:, [body.link for body in bodies]])


def reduced_pace(path: JointPath, cell: Workcell, pace: float = FULL) -> float:
    """The largest pace, at most `pace`, at which every point of arm and tool stays under `REDUCED_M_S`."""
    fastest_m_s = float(speeds_m_s(path, cell).max())
    return min(pace, _KEPT * REDUCED_M_S / fastest_m_s) if fastest_m_s > 0.0 else pace


def _bound_m_s(cell: Workcell) -> tuple[float, str]:
    """The largest speed of a point on the flange in any motion that the cell accepts, and its body."""
    limits = FLANGE[cell.arm.name]
    reach_m, point = max(
        (
            (float(np.linalg.norm(end)) + body.radius_m, body.name)
            for body in moving(cell.tool)
            if body.link == FLANGE_FRAME
            for end in (body.start_m, body.end_m)
        ),
        default=(0.0, "the flange"),
    )
    return limits.m_s + limits.rad_s * reach_m, point
