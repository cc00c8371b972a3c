"""Stopping along a path: the only way a motion ends early.

The arm keeps to the path and only its clock slows, as hard as `hw.path_clock` says that the limits permit. The samples
of every stop are checked at 1 kHz against every limit of joints, torques and flange; a stop that breaks one is tried
again more gently. Before the motion, a check ensures that a stop within `LONGEST_S` exists at every moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hw.errors import MotionRefused
from hw.joint_limits import DT_S, derivatives
from hw.motion_limits import MotionLimits
from hw.path_clock import path_clock, slowed
from hw.types import PATH_RATE_HZ, Array, ContactWindow, JointPath, frozen_array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

STOP_S = 0.4
"""The longest time from the wish to stop to standstill. A path that cannot be stopped in it is refused."""
LONGEST_S = 0.35
"""The longest stop. What is left of `STOP_S` is the time until the next moment at which one may begin, and the arm's
lag."""
EVERY_S = 0.02
SHARES = ((0.95, 0.7), (0.9, 0.4), (0.8, 0.2), (0.6, 0.1), (0.4, 0.05))
"""Tried in turn: shares of the hardest and the sharpest braking that the limits seem to permit."""
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
        """Whether a stop is possible at every moment."""
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

    The contact window lasts until the slowed path has left it. Raises MotionRefused if no stop keeps the limits.
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
    """The stop from each path time (K,): that of the first of `SHARES` which keeps the limits."""
    spline = joint_spline(path)
    clock = path_clock(path, spline, limits)
    duration_s, found = np.full(len(at_s), np.inf), at_s[None]
    for hard, sharp in SHARES:
        open_ = np.flatnonzero(np.isinf(duration_s))
        if not len(open_):
            break
        s, took_s = slowed(clock, at_s[open_], hard, sharp, LONGEST_S)
        open_, s, took_s = open_[ends := np.isfinite(took_s)], s[:, ends], took_s[ends]
        kept = _keeps(path, spline, s, took_s, limits)
        longer = max(len(s) - len(found), 0)
        found = np.concatenate([np.broadcast_to(found, (len(found), len(at_s))), np.repeat(found[-1:], longer, axis=0)])
        found[: len(s), open_[kept]], found[len(s) :, open_[kept]] = s[:, kept], s[-1, kept]
        duration_s[open_[kept]] = took_s[kept]
    rows = round(float(np.max(duration_s, initial=0.0, where=np.isfinite(duration_s))) * PATH_RATE_HZ) + 1
    return Braking(at_s, duration_s, np.broadcast_to(found, (len(found), len(at_s)))[:rows].T)


def _keeps(path: JointPath, spline: CubicSpline, s: Array, took_s: Array, limits: MotionLimits) -> NDArray[np.bool_]:
    """Which stops, path times (M, K) of durations (K,), keep the limits (K,)."""
    kept = np.zeros(len(took_s), dtype=bool)
    order, done = np.argsort(took_s, kind="stable"), 0
    while done < len(order):
        first = round(took_s[order[done]] * PATH_RATE_HZ) + 1
        some = order[done : done + max(1, AT_ONCE // first)]
        done += len(some)
        rows = round(took_s[some].max() * PATH_RATE_HZ) + 1
        before = s[0, some] + np.arange(-_LEAD, 0)[:, None] * DT_S
        q_rad = spline(np.clip(np.concatenate([before, s[:rows, some]]), 0.0, path.duration_s))
        kept[some] = _worst_ratio(q_rad, limits) <= 1.0
    return kept


def _worst_ratio(q_rad: Array, limits: MotionLimits) -> Array:
    """Samples (M, K, 7) that begin in motion and end at rest -> (K,) the largest ratio of a value to its limit."""
    dq, ddq, dddq = (d[_LEAD:] for d in derivatives(q_rad))  # drop the standstill assumed before the first sample
    q = np.concatenate([q_rad[_LEAD:], np.repeat(q_rad[-1:], _LEAD, axis=0)])
    joints = limits.joints
    ratios = np.concatenate([joints.ratios(q, dq, ddq), np.abs(dddq)[None] / joints.dddq_max_rad_s3])
    worst = np.asarray(ratios.max(axis=(0, 1, -1)))
    kept = worst <= 1.0
    worst[kept] = np.maximum(worst[kept], limits.ratio(q[:, kept], dq[:, kept], ddq[:, kept], DT_S))
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
