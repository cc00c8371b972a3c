"""How hard the clock of a path may brake: the limits of joints, torques and flange as limits of path time.

Path time s runs at v = ds/dt; q(s(t)) has the acceleration q' dv/dt + q'' v². So every limit of an acceleration or a
torque bounds dv/dt at a place s and a v², as in time-optimal path parameterisation (Bobrow, Dubowsky and Gibson, "Time-
optimal control of robotic manipulators along specified paths", 1985). Limits of jerks and torque rates bound d²v/dt²
in the same way. Both are bounds for a stop to aim at; `hw.braking` checks its samples against the limits themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hw.dynamics import asked
from hw.joint_limits import DT_S
from hw.motion_limits import FLANGE, RATED_NM, TORQUE_RATE_NM_S, TORQUE_SHARE, MotionLimits
from hw.types import PATH_RATE_HZ, Array, JointPath

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

PIECES = 4
"""The bound on dv/dt is convex in v², so linear pieces between 0 and 1 never lie below it."""
HARDEST_S2 = 60.0
SHARPEST_S3 = 4000.0
"""Harder than that no stop needs to be: at rest it takes 45 ms."""
AHEAD_S = 0.025
"""How far a brake looks ahead for a place that permits less."""
AHEAD_OF_JERK_S = 0.08
OWN_SHARE = 0.95
"""The most of a limit of jerk or torque rate that counts as used by the path itself."""
LANDING = 0.6
"""Share of d²v/dt² with which a brake is let go, so that it can follow."""
_SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class PathClock:
    """The bounds at the path's samples, each the tightest of a little way ahead."""

    hardest_s2: Array  # (N, PIECES + 1) the least dv/dt, at v² = 0, 1 / PIECES ... 1
    sharpest_s3: Array  # (N,) the largest d²v/dt²
    duration_s: float


def path_clock(path: JointPath, spline: CubicSpline, limits: MotionLimits) -> PathClock:
    """The bounds of a path within its limits; `spline` is its `hw.braking.joint_spline`."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # noqa: PLC0415 - as for the spline

    first, second, third = (spline(path.t_s, order) for order in (1, 2, 3))
    true_rad, still = path.q_rad + limits.zeros_rad, np.zeros_like(first)
    weight_Nm = asked(true_rad, still, still, limits.load).torque_Nm
    at_speed, by_brake = asked(true_rad, first, second, limits.load), asked(true_rad, still, first, limits.load)
    slope = np.concatenate([first, by_brake.torque_Nm - weight_Nm], axis=1)  # of dv/dt
    curve = np.concatenate([second, at_speed.torque_Nm - weight_Nm], axis=1)  # of v²
    rest = np.concatenate([still, weight_Nm], axis=1)
    most = np.concatenate([limits.joints.ddq_max_rad_s2, TORQUE_SHARE * RATED_NM])
    size, sign = np.maximum(np.abs(slope), _SMALL), np.where(slope < 0.0, -1.0, 1.0)
    at_rest, of_speed = (most + sign * rest) / size, sign * curve / size
    squares = np.linspace(0.0, 1.0, PIECES + 1)
    hardest = np.stack([(-at_rest - of_speed * square).max(axis=1) for square in squares], axis=1)
    flange = FLANGE[limits.model]
    for braked, fast, largest in (
        (by_brake.flange_m_s2, at_speed.flange_m_s2, flange.m_s2),
        (by_brake.flange_rad_s2, at_speed.flange_rad_s2, flange.rad_s2),
    ):
        hardest = np.maximum(hardest, _least_of_vector(braked, fast, largest, squares))
    own = np.concatenate([third, np.gradient(at_speed.torque_Nm, DT_S, axis=0)], axis=1)
    fastest = np.concatenate([limits.joints.dddq_max_rad_s3, np.full(len(RATED_NM), TORQUE_RATE_NM_S)])
    left = fastest - np.minimum(np.abs(own), OWN_SHARE * fastest)
    sharpest = np.minimum((left / size).min(axis=1), SHARPEST_S3)
    near, far = (round(ahead_s * PATH_RATE_HZ) for ahead_s in (AHEAD_S, AHEAD_OF_JERK_S))
    return PathClock(
        maximum_filter1d(np.clip(hardest, -HARDEST_S2, 0.0), near, axis=0, origin=-(near // 2), mode="nearest"),
        minimum_filter1d(sharpest, far, origin=-(far // 2), mode="nearest"),
        path.duration_s,
    )


def _least_of_vector(braked: Array, fast: Array, largest: float, squares: Array) -> Array:
    """(N, 3), (N, 3) -> (N, P): the least u with |braked u + fast v²| <= largest."""
    a = np.maximum((braked * braked).sum(axis=1), _SMALL**2)[:, None]
    b = (braked * fast).sum(axis=1)[:, None] * squares
    c = (fast * fast).sum(axis=1)[:, None] * squares**2 - largest**2
    return np.asarray((-b - np.sqrt(np.maximum(b * b - a * c, 0.0))) / a)


def slowed(clock: PathClock, at_s: Array, hard: float, sharp: float, longest_s: float) -> tuple[Array, Array]:
    """Brake from path times (K,) with shares `hard` and `sharp` of what the clock permits.

    Returns path times (M, K), every millisecond from the beginning until the last is at rest, and durations (K,), inf
    where it does not come to rest within `longest_s`.
    """
    last = len(clock.hardest_s2) - 1
    jerk = sharp * clock.sharpest_s3[np.minimum(np.rint(at_s * PATH_RATE_HZ).astype(int), last)]
    s, v, u = at_s.astype(np.float64), np.ones(len(at_s)), np.zeros(len(at_s))
    rows, duration_s = [s], np.full(len(at_s), np.inf)
    for step in range(1, round(longest_s * PATH_RATE_HZ) + 1):
        sample = np.minimum((s * PATH_RATE_HZ).astype(int), last)
        square = PIECES * v * v
        piece = np.minimum(square.astype(int), PIECES - 1)
        low, high = clock.hardest_s2[sample, piece], clock.hardest_s2[sample, piece + 1]
        least = hard * (low + (square - piece) * (high - low))
        wanted = np.maximum(least, -np.sqrt(2.0 * LANDING * jerk * v))
        now = np.minimum(np.clip(wanted, u - jerk * DT_S, u + jerk * DT_S), 0.0)
        slower = np.maximum(v + 0.5 * DT_S * (u + now), 0.0)
        s, v, u = np.minimum(s + 0.5 * DT_S * (v + slower), clock.duration_s), slower, now
        rows.append(s)
        rests = (v <= 0.0) | (s >= clock.duration_s)
        duration_s[rests & np.isinf(duration_s)] = step * DT_S
        if rests.all():
            break
    return np.stack(rows), duration_s
