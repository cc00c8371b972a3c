"""From the log of a guarded motion to its contact, and to its way back."""

from __future__ import annotations

import numpy as np

from hw.braking import brake
from hw.franka.playback import TOUCH, PlayableMotion, Played, motion_of
from hw.franka.starting import SLOW_FADE_S, PathCheck, from_held
from hw.guarding import withdrawal
from hw.motion_limits import MotionLimits
from hw.types import PATH_RATE_HZ, Array, Contact, JointPath


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
