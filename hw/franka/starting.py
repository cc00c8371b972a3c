"""Begins a path at the joints that the arm holds, which sag a little under its load."""

from __future__ import annotations

import numpy as np

from hw.errors import MotionRefused
from hw.franka.checks import PathCheck
from hw.limits import START_TOLERANCE_RAD
from hw.types import Array, JointPath

FADE_S = 0.5
SLOW_FADE_S = 2.0
"""For guarded motions: their speed is limited too."""
SAME_RAD = 1e-6
"""States come in single precision, so the held joints may differ by this much from the last command."""


def from_held(path: JointPath, q_held_rad: Array, model: str, check: PathCheck, fade_s: float) -> JointPath:
    """`path`, begun at the joints (7,) that the arm's controller holds: the arm rejects a jump.

    The difference is the sag under load. It fades over `fade_s`, and `check` checks the result again. Raises
    MotionRefused if the difference is too large for a sag, and the errors of `check`.
    """
    off = q_held_rad - path.q_rad[0]
    if np.abs(off).max() <= SAME_RAD:
        return path
    if np.abs(off).max() > START_TOLERANCE_RAD:
        joint = int(np.abs(off).argmax())
        raise MotionRefused(
            f"{model}: distance from the arm's commanded position of joint {joint + 1} is "
            f"{abs(off[joint]):.4g} rad, limit {START_TOLERANCE_RAD:g} rad; nothing has moved, plan from there"
        )
    u = np.minimum(path.t_s / min(fade_s, path.duration_s), 1.0)
    left = 1.0 - u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    faded = JointPath(path.t_s, path.q_rad + left[:, None] * off, path.contact)
    check(faded)
    return faded
