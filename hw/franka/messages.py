"""How strict the player is with time, and its answers to the program."""

from __future__ import annotations

from dataclasses import dataclass

from hw.franka.driver import Failure
from hw.franka.playback import START_S, Played
from hw.watchdog import SILENCE_S


@dataclass(frozen=True)
class Timing:
    """How strict the player is with time. Only tests change the defaults."""

    realtime: bool = True  # demand a real-time kernel and priority
    silence_s: float = SILENCE_S  # longest silence of the program during a motion, as of the pedal
    start_s: float = START_S  # longest time from the check of a motion to its first cycle
    overrun_s: float = 5.0  # how long after its end a motion may go unanswered


@dataclass(frozen=True)
class Rhythm:
    """How evenly the arm's states arrived."""

    states: int
    missed: int  # milliseconds of the arm's clock without one
    longest_gap_s: float  # on the computer's clock
    interface: (
        int | None
    )  # version of the arm's server; None: the SDK does not report it, and has refused any but its own


@dataclass(frozen=True, eq=False)
class PlayOutcome:
    """What came of a motion: the log, and the failure that ended it, if one did."""

    played: Played
    failure: Failure | None = None
