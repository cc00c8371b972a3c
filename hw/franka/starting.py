"""The bounds on the time and the motion between the check of a path and its first command, and the measurement of what
an arm needs.

Each could refuse every motion of a real arm if it were guessed wrong, so each is a setting with a safe range, and the
doctor measures the values that the arm needs (`Rehearsal`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10

from hw.types import number

UNWATCHED_S, START_S, HELD_RAD = 0.2, 1.0, 3e-5
"""The defaults of `Starting`."""
UNWATCHED_RANGE_S = (0.05, 0.5)
"""A command over TCP ends when the arm has answered; libfranka looks for the answer every 10 ms (`kTimeout` of its
network.h) and reads no state meanwhile. Below 0.05 s one slow answer refuses a motion. The stop button of the arm
latches: nobody presses it and pulls it again within 0.5 s. libfranka itself gives up after 1 s without a state."""
START_RANGE_S = (0.5, 2.0)
"""Three commands pass between the check and the first cycle, and the answer to each comes at most one `tcp_timeout` of
libfranka (1 s) late. After 2 s a person may have changed the lab."""
HELD_RANGE_RAD = (3e-6, 1e-4)
"""States are in single precision, which is exact to 2e-7 rad: 3e-6 rad is what one step may command (3 rad/s² and
3000 rad/s³). 1e-4 rad are 0.1 mm at 1 m, a twentieth of the smallest clearance (2 mm over the table); faded over 0.5 s
they add at most 0.003 rad/s² and 0.05 rad/s³ to the motion."""

SPARE = 1.5
"""A bound should be this many times the measured value."""


@dataclass(frozen=True)
class Starting:
    """The bounds of one arm."""

    unwatched_s: float = UNWATCHED_S  # longest pause without a state of the arm (arm's clock)
    start_s: float = START_S  # longest time from sending a checked motion to its first cycle
    held_rad: float = HELD_RAD  # how far the held joints may have gone since the check; the motion fades it out

    def __post_init__(self) -> None:
        """Raises ValueError for a value outside its safe range."""
        number(self.unwatched_s, "pause without a state of the arm", *UNWATCHED_RANGE_S, "s")
        number(self.start_s, "time from check to start", *START_RANGE_S, "s")
        number(self.held_rad, "change of the held joints before a start", *HELD_RANGE_RAD, "rad")


@dataclass(frozen=True)
class Rehearsal:
    """The times that an arm needed in starts without a motion, and the drift of its held joints at rest."""

    starts: int
    pause_s: float  # the longest without a state in any of them
    took_s: float  # the longest that one took
    rest_s: float  # how long the held joints were watched
    wander_rad: float  # the most that a held joint went within `START_S`

    def bounds(self) -> dict[str, tuple[float, tuple[float, float], str]]:
        """Setting -> its measured value, its safe range, its unit."""
        return {
            "unwatched_s": (self.pause_s, UNWATCHED_RANGE_S, "s"),
            "start_s": (self.took_s, START_RANGE_S, "s"),
            "held_rad": (self.wander_rad, HELD_RANGE_RAD, "rad"),
        }


def proposed(measured: float, safe: tuple[float, float]) -> float | None:
    """A bound with room to spare, rounded to two digits, within its safe range; None if that range is too small."""
    low, high = safe
    if SPARE * measured > high:
        return None
    if SPARE * measured <= low:
        return low
    step = 10.0 ** (floor(log10(SPARE * measured)) - 1)
    return min(round(ceil(SPARE * measured / step - 1e-9) * step, 12), high)
