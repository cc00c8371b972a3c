"""Stops a motion along its path, which is the only way in which it ends early, and plays a path at a slower pace.

The arm keeps to the path and only its clock slows, as hard as the limits permit.
Path time s runs at v = ds/dt; q(s(t)) has the acceleration q' dv/dt + q'' v². So every limit of an
acceleration or a torque bounds dv/dt at a place s and a v², as in time-optimal path parameterisation (Bobrow, Dubowsky
and Gibson, "Time-optimal control of robotic manipulators along specified paths", 1985). Limits of jerks and torque
rates bound d²v/dt² in the same way.

Stops are planned with both bounds. Then the samples of every stop are checked at 1 kHz against every limit of joints,
torques and flange; a stop that breaks a limit is planned again more gently. Before the motion, a check ensures that a
stop within `LONGEST_S` exists at every moment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hw.dynamics import demand_of
from hw.errors import MotionRefused
from hw.joint_limits import DT_S, derivatives
from hw.motion_limits import FLANGE, RATED_NM, TORQUE_RATE_NM_S, TORQUE_SHARE, MotionLimits
from hw.types import PATH_RATE_HZ, Array, ContactWindow, JointPath, frozen_array, number
from hw.watchdog import SILENCE_S, WORD_EVERY_S

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

PIECES = 4
"""The bound on dv/dt is convex in v², so linear pieces between 0 and 1 never lie below it."""
HARDEST_S2 = 60.0
SHARPEST_S3 = 4000.0
"""Upper bound on braking: from rest it takes 45 ms."""
AHEAD_S = 0.025
"""How far a brake looks ahead for a place that permits less."""
AHEAD_OF_JERK_S = 0.08
OWN_SHARE = 0.95
"""The path itself counts as using at most this share of a limit of jerk or torque rate."""
LANDING = 0.6
"""Share of the bound on d²v/dt² with which braking is released, so that it can follow the limits."""
_SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class _PathClock:
    """The bounds at the path's samples; each is the tightest over a short way ahead."""

    hardest_s2: Array  # (N, PIECES + 1) the least dv/dt, at v² = 0, 1 / PIECES ... 1
    sharpest_s3: Array  # (N,) the largest d²v/dt²
    duration_s: float


def _path_clock(path: JointPath, spline: CubicSpline, limits: MotionLimits) -> _PathClock:
    """The bounds of a path within its limits; `spline` is its `joint_spline`."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # noqa: PLC0415 - as for `joint_spline`

    first, second, third = (spline(path.t_s, order) for order in (1, 2, 3))
    true_rad, still = path.q_rad + limits.zeros_rad, np.zeros_like(first)
    weight_Nm = demand_of(limits.model, true_rad, still, still, limits.load).torque_Nm
    at_speed, by_brake = (
        demand_of(limits.model, true_rad, first, second, limits.load),
        demand_of(limits.model, true_rad, still, first, limits.load),
    )
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
    return _PathClock(
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


def _braked(clock: _PathClock, at_s: Array, hard: float, sharp: float, longest_s: float) -> tuple[Array, Array]:
    """Brake from path times (K,) with shares `hard` and `sharp` of the clock's limits.

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
        target = np.maximum(least, -np.sqrt(2.0 * LANDING * jerk * v))
        now = np.minimum(np.clip(target, u - jerk * DT_S, u + jerk * DT_S), 0.0)
        slower = np.maximum(v + 0.5 * DT_S * (u + now), 0.0)
        s, v, u = np.minimum(s + 0.5 * DT_S * (v + slower), clock.duration_s), slower, now
        rows.append(s)
        rests = (v <= 0.0) | (s >= clock.duration_s)
        duration_s[rests & np.isinf(duration_s)] = step * DT_S
        if rests.all():
            break
    return np.stack(rows), duration_s


STOP_S = 0.4
"""The longest time from the wish to stop to standstill. A path that cannot be stopped in it is refused."""
LONGEST_S = 0.35
"""The longest stop. The rest of `STOP_S` is the time until the next moment at which a stop may begin, and the arm's
lag."""
STOPS_EVERY_S = 0.01
"""The time between the moments of a path at which a stop is planned, and so may begin."""
HEARD_S = WORD_EVERY_S + DT_S
"""Time until the player hears of the pedal's silence: the wait for the program's next word, and one cycle."""
NEXT_STOP_S = 2.0 * STOPS_EVERY_S
"""The longest wait for a moment at which a stop may begin (`hw.franka.playback.motion_of`)."""
LAG_S = STOP_S - LONGEST_S - NEXT_STOP_S
"""How far an arm may be behind its commands."""
BEFORE_S = SILENCE_S + HEARD_S + NEXT_STOP_S
"""Time from the wish to stop to the first slowed command, at worst."""
WORST_STOP_S = BEFORE_S + LONGEST_S + LAG_S
"""Time from the wish to stop to rest, in any motion that the program accepts."""
EVERY_S = 0.02
SHARES = ((0.95, 0.7), (0.9, 0.4), (0.8, 0.2), (0.6, 0.1), (0.4, 0.05))
"""Pairs of shares, tried in turn: of the largest deceleration and of the largest jerk that the limits seem to
permit."""
AT_ONCE = 4_000
"""Samples that are checked in one go, for the sake of memory."""

_LEAD = 3
"""Samples of the unbraked path before the brake; the differences need them."""


@dataclass(frozen=True, eq=False)
class Braking:
    """The stops of a path, by the path time at which they begin."""

    at_s: Array  # (K,)
    duration_s: Array  # (K,) inf where no stop of `LONGEST_S` keeps the limits
    path_time_s: Array  # (K, M) path time every millisecond from the beginning of the stop, held once it stands still

    def __post_init__(self) -> None:
        at_s = frozen_array(self.at_s, (None,), "at_s")
        object.__setattr__(self, "at_s", at_s)
        object.__setattr__(self, "path_time_s", frozen_array(self.path_time_s, (len(at_s), None), "path_time_s"))

    @property
    def ok(self) -> bool:
        """Whether the arm can stop at every moment."""
        return bool(np.isfinite(self.duration_s).all())

    @property
    def longest_s(self) -> float:
        """Duration of the longest stop."""
        return float(self.duration_s.max())


def check_braking(path: JointPath, limits: MotionLimits, every_s: float = EVERY_S) -> Braking:
    """A stop within `limits` for every `every_s` seconds of the path."""
    at = np.arange(0, len(path.t_s), max(1, round(every_s * PATH_RATE_HZ)))
    return _stops(path, path.t_s[at], limits)


def brake(path: JointPath, at_s: float, limits: MotionLimits) -> JointPath:
    """`path` until `at_s`, then slowed to rest along itself within `limits`.

    The contact window is extended until the slowed path has left it. Raises MotionRefused if no stop keeps the limits.
    """
    at = round(float(np.clip(at_s, 0.0, path.duration_s)) * PATH_RATE_HZ)
    start_s = at / PATH_RATE_HZ
    stop = _stops(path, np.array([start_s]), limits)
    if not stop.ok:
        raise MotionRefused(
            f"{limits.model}: no stop of up to {LONGEST_S:g} s from t = {start_s:.3f} s keeps the limits; "
            "plan a slower path"
        )
    s = stop.path_time_s[0, 1:]
    q_rad = np.concatenate([path.q_rad[: at + 1], joint_spline(path)(s)])
    return JointPath(np.arange(len(q_rad)) / PATH_RATE_HZ, q_rad, _window(path.contact, start_s, s))


def _stops(path: JointPath, at_s: Array, limits: MotionLimits) -> Braking:
    """The stop from each path time (K,), with the first of `SHARES` that keeps the limits."""
    spline = joint_spline(path)
    clock = _path_clock(path, spline, limits)
    duration_s, courses = np.full(len(at_s), np.inf), at_s[None]
    for hard, sharp in SHARES:
        open_ = np.flatnonzero(np.isinf(duration_s))
        if not len(open_):
            break
        s, took_s = _braked(clock, at_s[open_], hard, sharp, LONGEST_S)
        open_, s, took_s = open_[ends := np.isfinite(took_s)], s[:, ends], took_s[ends]
        valid = _keeps(path, spline, s, took_s, limits)
        longer = max(len(s) - len(courses), 0)
        courses = np.concatenate(
            [np.broadcast_to(courses, (len(courses), len(at_s))), np.repeat(courses[-1:], longer, axis=0)]
        )
        courses[: len(s), open_[valid]], courses[len(s) :, open_[valid]] = s[:, valid], s[-1, valid]
        duration_s[open_[valid]] = took_s[valid]
    rows = round(float(np.max(duration_s, initial=0.0, where=np.isfinite(duration_s))) * PATH_RATE_HZ) + 1
    return Braking(at_s, duration_s, np.broadcast_to(courses, (len(courses), len(at_s)))[:rows].T)


def _keeps(path: JointPath, spline: CubicSpline, s: Array, took_s: Array, limits: MotionLimits) -> NDArray[np.bool_]:
    """(K,) whether each stop, with path times (M, K) and durations (K,), keeps the limits."""
    allowed = np.zeros(len(took_s), dtype=bool)
    order, done = np.argsort(took_s, kind="stable"), 0
    while done < len(order):
        first = round(took_s[order[done]] * PATH_RATE_HZ) + 1
        some = order[done : done + max(1, AT_ONCE // first)]
        done += len(some)
        rows = round(took_s[some].max() * PATH_RATE_HZ) + 1
        before = s[0, some] + np.arange(-_LEAD, 0)[:, None] * DT_S
        q_rad = spline(np.clip(np.concatenate([before, s[:rows, some]]), 0.0, path.duration_s))
        allowed[some] = _worst_ratio(q_rad, limits) <= 1.0
    return allowed


def _worst_ratio(q_rad: Array, limits: MotionLimits) -> Array:
    """Samples (M, K, 7) that begin in motion and end at rest -> (K,) the largest ratio of a value to its limit."""
    dq, ddq, dddq = (d[_LEAD:] for d in derivatives(q_rad))  # drop the standstill assumed before the first sample
    q = np.concatenate([q_rad[_LEAD:], np.repeat(q_rad[-1:], _LEAD, axis=0)])
    joints = limits.joints
    ratios = np.concatenate([joints.ratios(q, dq, ddq), np.abs(dddq)[None] / joints.dddq_max_rad_s3])
    worst = np.asarray(ratios.max(axis=(0, 1, -1)))
    within = worst <= 1.0
    worst[within] = np.maximum(worst[within], limits.ratio(q[:, within], dq[:, within], ddq[:, within], DT_S))
    return worst


def _window(contact: ContactWindow | None, start_s: float, s: Array) -> ContactWindow | None:
    """The window on the slowed clock; None if the path stops before it."""
    if contact is None or contact.start_s > max(start_s, s[-1]):
        return None

    def slowed(t_s: float) -> float:
        return t_s if t_s <= start_s else start_s + min(int(np.searchsorted(s, t_s)) + 1, len(s)) / PATH_RATE_HZ

    return ContactWindow(slowed(contact.start_s), slowed(contact.end_s), contact.depth_m, contact.force_N)


def joint_spline(path: JointPath) -> CubicSpline:
    """The path between its samples: a cubic spline in rad over seconds, at rest at both ends."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import, and every task imports this module

    return CubicSpline(path.t_s, path.q_rad, bc_type="clamped")


SLOWEST = 0.1
FULL = 1.0


def slowed(path: JointPath, pace: float) -> JointPath:
    """`path` and its contact window, with their times divided by `pace`. Raises ValueError for a pace outside 0.1 to 1.

    The player checks every limit of the result again, as for any path.
    """
    number(pace, "pace", SLOWEST, FULL)
    return at_pace(path, pace)


def at_pace(path: JointPath, pace: float) -> JointPath:
    """The same as `slowed` at any pace; the reduced speed may need a slower pace than an operator may choose."""
    number(pace, "pace", 0.0, FULL, above=True)
    if pace == FULL:
        return path
    t_s = np.arange(math.ceil(path.duration_s / pace * PATH_RATE_HZ) + 1) / PATH_RATE_HZ
    q_rad = joint_spline(path)(np.minimum(t_s * pace, path.duration_s))
    window = path.contact
    slow = None if window is None else _stretched(window, 1.0 / pace)
    return JointPath(t_s, q_rad, slow)


def _stretched(window: ContactWindow, by: float) -> ContactWindow:
    return ContactWindow(by * window.start_s, by * window.end_s, window.depth_m, window.force_N)
