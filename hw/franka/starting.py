"""Before an arm plays a path: the checks, its beginning at the joints that the arm holds, and the load it feels."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hw.errors import MotionRefused
from hw.guarding import check_guarded, require_guarded
from hw.kinematics import jacobian
from hw.limits import START_TOLERANCE_RAD, refuse_beyond
from hw.types import Array, Guard, JointPath
from hw.workcell import Workcell

FADE_S = 0.5
SLOW_FADE_S = 2.0
"""For guarded motions: their speed is limited too."""
SAME_RAD = 1e-6
"""States come in single precision, so the held joints may differ by this much from the last command."""


PathCheck = Callable[[JointPath, Array | None], object]
"""Raises MotionRefused for a path that must not be played; given the present joints (7,), it has to begin there."""


def until(guard: Guard, cell: Workcell) -> PathCheck:
    """The check of a motion that ends at a touch. A motion played to its end is checked by `Workcell.require`."""
    return lambda path, q_now_rad: require_guarded(path, guard, cell, q_now_rad)


def back_from(guard: Guard, cell: Workcell) -> PathCheck:
    """The check of the way back from the touch, which declares no contact."""
    return lambda path, q_now_rad: refuse_beyond(check_guarded(path, guard, cell, q_now_rad))


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
    check(faded, None)
    return faded


GRAVITY_M_S2 = 9.81
UNDECLARED_KG = 0.5
"""A larger difference stops the first motion. A torque error of 0.8 Nm in every joint counts as 0.2 kg."""
READINGS = 100
"""States to average, one per millisecond, after as many in which the arm's estimate settles."""


def undeclared_kg(q_rad: Array, external_Nm: Array, com_F_m: Array) -> float:
    """The mass in kg at `com_F_m` (3,) in the flange that best explains external torques (7,) at true joints (7,)."""
    per_kg = GRAVITY_M_S2 * jacobian(q_rad, com_F_m)[2]
    return float(abs(per_kg @ external_Nm) / (per_kg @ per_kg))


def require_declared(model: str, q_rad: Array, external_Nm: Sequence[Sequence[float]], com_F_m: Array) -> None:
    """`external_Nm` (N, 7) at rest, the payload set. Raises MotionRefused if the arm feels another load."""
    felt_kg = undeclared_kg(q_rad, np.mean(np.asarray(external_Nm), axis=0), com_F_m)
    if felt_kg > UNDECLARED_KG:
        raise MotionRefused(
            f"{model}: at rest the arm feels {felt_kg:.2f} kg more or less than the declared payload (at most "
            f"{UNDECLARED_KG:g} kg); nothing has moved. Correct the payload in the rig file and the end effector in "
            "Desk, or clear what leans on the arm: guide it free by hand"
        )
