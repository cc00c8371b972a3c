"""The steps before a motion of an arm: its checks, its beginning at the joints that the arm holds, and the load that
the arm feels.

After the motion, its stop is read from its log.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.dynamics import GRAVITY_M_S2
from hw.errors import MotionRefused
from hw.franka.driver import Reading
from hw.franka.playback import NONSENSE, STILL_RAD_S, Played
from hw.kinematics import forward, jacobian
from hw.limits import START_TOLERANCE_RAD
from hw.types import PATH_RATE_HZ, Array, JointPath
from hw.watchdog import IN_WORDS

FADE_S = 0.5
SAME_RAD = 1e-6
"""States come in single precision, so the held joints may differ by this much from the last command."""


PathCheck = Callable[[JointPath, Array | None], object]
"""Raises MotionRefused for a path that must not be played. If the present joints (7,) are given, it has to begin there.
"""


def from_held(path: JointPath, q_held_rad: Array, model: str, check: PathCheck) -> JointPath:
    """`path`, begun at the joints (7,) that the arm's controller holds: the arm rejects a jump.

    The difference is the sag under load. It fades over `FADE_S`, and `check` is applied to the result again. Raises
    MotionRefused if the difference is too large for a sag, and the errors of `check`.
    """
    off = q_held_rad - path.q_rad[0]
    if np.abs(off).max() <= SAME_RAD:
        return path
    if np.abs(off).max() > START_TOLERANCE_RAD:
        joint = int(np.abs(off).argmax())
        raise MotionRefused(
            f"{model}: joint {joint + 1} starts {abs(off[joint]):.4g} rad from the position that the arm "
            f"commands, limit {START_TOLERANCE_RAD:g} rad; nothing has moved, plan from there"
        )
    u = np.minimum(path.t_s / min(FADE_S, path.duration_s), 1.0)
    left = 1.0 - u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    faded = JointPath(path.t_s, path.q_rad + left[:, None] * off, path.contact)
    check(faded, None)
    return faded


UNDECLARED_KG = 0.5
"""A larger difference stops the first motion. A torque error of 0.8 Nm in every joint counts as 0.2 kg."""
READINGS = 100
"""Number of states to average, one per millisecond. As many states before them let the arm's estimate settle."""


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


WHY = {**IN_WORDS, NONSENSE: "the arm reported joints that no arm can have"}


BY_ITSELF, BUTTON = "the arm", "the stop button"
"""The reasons of a stop that the arm's controller made: by itself, or because a person pressed its stop button."""


@dataclass(frozen=True)
class StopReport:
    """Times on the arm's clock and the measured travel of the flange, counted from the player's decision to stop."""

    why: str  # "pedal", "request", "silence", "orphaned", `BY_ITSELF`, `BUTTON`
    at_s: float  # path time
    braking_after_s: float  # until the first slowed command
    still_after_s: float  # until every joint stays slower than `STILL_RAD_S`
    way_m: float  # travel of the flange until then
    braked_clock_s: float  # time.monotonic() of the first slowed command
    q_rad: Array | None = field(default=None, compare=False, repr=False)  # (K, 7) measured, one a millisecond, to rest

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
    q_rad = played.q_measured_rad[first : still + 1]
    flange_m = forward(q_rad)[:, :3, 3]
    return StopReport(
        played.stop_wanted,
        float(played.t_s[first]),
        float(played.t_s[played.braked_at] - played.t_s[first]),
        float(played.t_s[still] - played.t_s[first]),
        float(np.linalg.norm(np.diff(flange_m, axis=0), axis=1).sum()),
        float(played.clock_s[played.braked_at]),
        q_rad,
    )


def arm_stop(played: Played, rest: Sequence[Reading]) -> StopReport | None:
    """The stop of an arm that stopped by itself, counted from its last cycle; `rest` are the readings after that.

    None if there was no cycle, or the arm was not seen to stand still.
    """
    moving = [max(map(abs, reading.dq_rad_s)) >= STILL_RAD_S for reading in rest]
    if not len(played.t_s) or not moving or moving[-1]:
        return None
    still = len(moving) - moving[::-1].index(True) if any(moving) else 0
    q_rad = np.array([played.q_measured_rad[-1], *(reading.q_rad for reading in rest[: still + 1])])
    flange_m = forward(q_rad)[:, :3, 3]
    return StopReport(
        BUTTON if any(reading.by_hand for reading in rest) else BY_ITSELF,
        float(played.t_s[-1]),
        0.0,
        (still + 1) / PATH_RATE_HZ,
        float(np.linalg.norm(np.diff(flange_m, axis=0), axis=1).sum()),
        float(played.clock_s[-1]),
        q_rad,
    )
