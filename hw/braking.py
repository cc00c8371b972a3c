"""Stopping along a path: the only way a motion ends early.

The arm keeps to the path and only its clock slows: path time s runs at ds/dt = 1 - S(t / T), with S the smooth step
of fifth order, so velocity, acceleration and jerk stay continuous. T is the shortest of a few durations that keep every
limit of joints, torques and flange at the 1 kHz samples. Before the motion, a check ensures that such a T exists at
every moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hw.errors import MotionRefused
from hw.joint_limits import DT_S, derivatives
from hw.motion_limits import MotionLimits
from hw.types import PATH_RATE_HZ, Array, ContactWindow, JointPath, frozen_array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

STOP_S = 0.9
"""The longest time from the wish to stop to standstill. A path that cannot be stopped in it is refused."""
DURATIONS_S = (0.04, 0.06, 0.09, 0.13, 0.18, 0.25, 0.35, 0.45, 0.6, 0.85)
"""The last leaves 0.05 s of `STOP_S`: 0.02 s until the next moment at which a stop may begin, and the arm's lag."""
EVERY_S = 0.02

_LEAD = 3
"""Samples of the unbraked path before the brake; the differences need them."""


@dataclass(frozen=True, eq=False)
class Braking:
    """How long a stop takes, as a function of the path time at which it begins."""

    at_s: Array  # (K,)
    duration_s: Array  # (K,) T of the time scaling; inf where none of `DURATIONS_S` keeps the limits

    def __post_init__(self) -> None:
        at_s = frozen_array(self.at_s, (None,), "at_s")
        object.__setattr__(self, "at_s", at_s)

    @property
    def ok(self) -> bool:
        """Whether a stop is possible at every moment."""
        return bool(np.isfinite(self.duration_s).all())

    @property
    def longest_s(self) -> float:
        """Duration of the longest stop."""
        return float(self.duration_s.max())


def check_braking(path: JointPath, limits: MotionLimits, every_s: float = EVERY_S) -> Braking:
    """The shortest stop within `limits`, for stops that begin every `every_s` seconds of the path."""
    at = np.arange(0, len(path.t_s), max(1, round(every_s * PATH_RATE_HZ)))
    return Braking(path.t_s[at], _durations(path, path.t_s[at], limits))


def brake(path: JointPath, at_s: float, limits: MotionLimits) -> JointPath:
    """`path` until `at_s`, then slowed to rest along itself within `limits`.

    The contact window lasts until the slowed path has left it. Raises MotionRefused if no stop keeps the limits.
    """
    at = round(float(np.clip(at_s, 0.0, path.duration_s)) * PATH_RATE_HZ)
    start_s = at / PATH_RATE_HZ
    duration_s = float(_durations(path, np.array([start_s]), limits)[0])
    if not np.isfinite(duration_s):
        raise MotionRefused(
            f"{limits.model}: no stop of up to {DURATIONS_S[-1]:g} s from t = {start_s:.3f} s keeps the limits; "
            "plan a slower path"
        )
    s = path_time(np.array([start_s]), duration_s)[0, _LEAD + 1 :]
    q_rad = np.concatenate([path.q_rad[: at + 1], joint_spline(path)(np.minimum(s, path.duration_s))])
    return JointPath(np.arange(len(q_rad)) / PATH_RATE_HZ, q_rad, _window(path.contact, start_s, s))


def _durations(path: JointPath, at_s: Array, limits: MotionLimits) -> Array:
    """(K,) path times -> (K,) shortest durations that keep the limits, inf where none does."""
    spline = joint_spline(path)
    shortest = np.full(len(at_s), np.inf)
    for duration_s in DURATIONS_S:
        open_ = ~np.isfinite(shortest)
        if not open_.any():
            break
        s = np.clip(path_time(at_s[open_], duration_s), 0.0, path.duration_s)
        shortest[open_] = np.where(_worst_ratio(np.swapaxes(spline(s), 0, 1), limits) <= 1.0, duration_s, np.inf)
    return shortest


def path_time(at_s: Array, duration_s: float) -> Array:
    """(K,) -> (K, M): path time every millisecond, from `_LEAD` samples before the brake until standstill."""
    steps = np.arange(-_LEAD, round(duration_s * PATH_RATE_HZ) + 1)
    u = np.clip(steps / (duration_s * PATH_RATE_HZ), 0.0, 1.0)
    lost = duration_s * u**4 * (2.5 - 3.0 * u + u**2)  # integral of the smooth step
    return np.asarray(at_s[:, None] + steps / PATH_RATE_HZ - lost)


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
