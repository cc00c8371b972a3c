"""From the log of a motion to its stop; of a guarded one also to its contact and its way back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.braking import brake
from hw.franka.playback import NONSENSE, STILL_RAD_S, TOUCH, PlayableMotion, Played, motion_of
from hw.franka.starting import SLOW_FADE_S, PathCheck, from_held
from hw.guarding import withdrawal
from hw.kinematics import forward
from hw.motion_limits import MotionLimits
from hw.types import PATH_RATE_HZ, Array, Contact, JointPath
from hw.watchdog import IN_WORDS

WHY = {**IN_WORDS, NONSENSE: "the arm reported a number that is none"}


@dataclass(frozen=True)
class StopReport:
    """Times on the arm's clock and the measured travel of the flange, counted from the player's decision to stop."""

    why: str  # "pedal", "request", "silence", "orphaned" or "touch"
    at_s: float  # path time
    braking_after_s: float  # until the first slowed command
    still_after_s: float  # until every joint stays slower than `STILL_RAD_S`
    way_m: float  # travel of the flange until then
    braked_clock_s: float  # time.monotonic() of the first slowed command

    def __str__(self) -> str:
        return (
            f"{self.at_s:.3f} s into the path; braking began after {1e3 * self.braking_after_s:.0f} ms, the arm stood "
            f"still after {1e3 * self.still_after_s:.0f} ms and {1e3 * self.way_m:.1f} mm"
        )


def stop_report(played: Played) -> StopReport | None:
    """None if nothing was braked."""
    if not played.stop_wanted or played.braked_at < 0:
        return None
    first = played.wanted_at
    moving = np.flatnonzero(np.abs(played.dq_measured_rad_s[first:]).max(axis=1) >= STILL_RAD_S)
    still = min(first + (int(moving[-1]) + 1 if len(moving) else 0), len(played.t_s) - 1)
    flange_m = forward(played.q_measured_rad[first : still + 1])[:, :3, 3]
    return StopReport(
        played.stop_wanted,
        float(played.t_s[first]),
        float(played.t_s[played.braked_at] - played.t_s[first]),
        float(played.t_s[still] - played.t_s[first]),
        float(np.linalg.norm(np.diff(flange_m, axis=0), axis=1).sum()),
        float(played.clock_s[played.braked_at]),
    )


def contact_of(played: Played, path: JointPath) -> Contact | None:
    """The contact felt along `path`; None if it did not end by a touch.

    Lost cycles are filled in: commanded joints from the path, measured joints and torques by linear interpolation.
    """
    if played.stop_wanted != TOUCH:
        return None
    felt = slice(0, played.wanted_at + 1)
    ticks = np.arange(round(played.t_s[played.wanted_at] * PATH_RATE_HZ) + 1)
    t_s = ticks / PATH_RATE_HZ

    def every_ms(log: Array) -> Array:
        return np.column_stack([np.interp(t_s, played.t_s[felt], column[felt]) for column in log.T])

    measured = every_ms(played.q_measured_rad)
    commanded = path.q_rad[np.minimum(ticks, len(path.t_s) - 1)]
    torque_Nm = every_ms(played.torque_Nm)
    return Contact(
        float(t_s[-1]), measured[-1], played.largest_N, t_s, commanded, measured, torque_Nm, played.success_rate
    )


def way_back(
    played: Played, path: JointPath, q_held_rad: Array, limits: MotionLimits, check: PathCheck
) -> PlayableMotion:
    """From the end of a motion along `path` back to its start, the way it came, begun at the held joints (7,).

    Cycles lost on the way there are filled in. Raises MotionRefused.
    """
    there = path if played.braked_from < 0 else brake(path, played.braked_from / PATH_RATE_HZ, limits)
    back = withdrawal(there)
    check(back, None)
    return motion_of(from_held(back, q_held_rad, limits.model, check, SLOW_FADE_S), limits)
