"""Where a path begins on an arm that hangs a little under its load."""

from __future__ import annotations

import numpy as np

from hw.errors import MotionRefused
from hw.franka.checks import PathCheck
from hw.limits import START_TOLERANCE_RAD
from hw.types import Array, JointPath

FADE_S = 0.5
SLOW_FADE_S = 2.0
"""For guarded motions, whose speed is limited too."""
SAME_RAD = 1e-6
"""States come in single precision: the held joints may differ by as much from what was commanded last."""


def from_held(path: JointPath, q_held_rad: Array, model: str, check: PathCheck, fade_s: float) -> JointPath:
    """`path`, begun at the joints (7,) that the arm's controller holds: a jump would be an error to the arm.

    The difference is a bending of the arm under load; it fades over `fade_s`, and what results is checked again by
    `check`. Raises MotionRefused where the difference is none of a bending, and what `check` raises.
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
