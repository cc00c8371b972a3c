"""The messages between the program and its player process."""

from __future__ import annotations

from dataclasses import dataclass

from hw.franka.driver import Failure, Reading
from hw.franka.playback import START_S, PlayableMotion, Played
from hw.franka.settings import FrankaSettings, Payload
from hw.types import Guard
from hw.watchdog import SILENCE_S


@dataclass(frozen=True)
class Timing:
    """How strict the player is with time. Only tests change the defaults."""

    realtime: bool = True  # demand a real-time kernel and priority
    silence_s: float = SILENCE_S  # longest silence of the program during a motion, as of the pedal
    start_s: float = START_S  # longest time from the check of a motion to its first cycle
    overrun_s: float = 5.0  # how long after its end a motion may go unanswered


@dataclass(frozen=True)
class Connect:
    """Ask the player to connect to the arm."""

    model: str
    settings: FrankaSettings
    timing: Timing


@dataclass(frozen=True)
class Read:
    """Ask for the arm's present state."""


@dataclass(frozen=True)
class Play:
    """Ask for a motion, to its end or to a touch."""

    motion: PlayableMotion
    guard: Guard | None = None  # brake at a touch


@dataclass(frozen=True)
class Recover:
    """Ask to clear a fault; nothing moves."""


@dataclass(frozen=True)
class Carry:
    """Tell the arm what its hand holds."""

    payload: Payload


@dataclass(frozen=True)
class Listen:
    """Read `states` states in a row, one per millisecond; nothing moves."""

    states: int


Request = Connect | Read | Play | Recover | Carry | Listen


@dataclass(frozen=True)
class Connected:
    """The answer to `Connect`."""

    reading: Reading
    notes: tuple[str, ...] = ()
    """Real-time properties that the computer denies the player (`hw.franka.realtime.settle`)."""


@dataclass(frozen=True)
class Rhythm:
    """The answer to `Listen`: how evenly the arm's states arrived."""

    states: int
    missed: int  # milliseconds of the arm's clock without one
    longest_gap_s: float  # on the computer's clock
    interface: (
        int | None
    )  # version of the arm's server; None: the SDK does not report it, and has refused any but its own


@dataclass(frozen=True, eq=False)
class PlayOutcome:
    """What came of a `Play`: the log, and the failure that ended it, if one did."""

    played: Played
    failure: Failure | None = None
