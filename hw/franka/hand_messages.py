"""The messages between the program, the hand's keeper and its worker."""

from __future__ import annotations

from dataclasses import dataclass

from hw.types import HandState


@dataclass(frozen=True)
class Open:
    """Connect to the hand of this model of arm, at its address."""

    model: str
    host: str


@dataclass(frozen=True)
class State:
    """Ask for the present state; nothing moves."""


@dataclass(frozen=True)
class Home:
    """Find the fingers' ends of travel."""


@dataclass(frozen=True)
class Move:
    """Bring the fingers to a width."""

    width_m: float


@dataclass(frozen=True)
class Grasp:
    """Close on something and hold it."""

    width_m: float
    force_N: float


@dataclass(frozen=True)
class Stop:
    """End whatever another connection has the fingers do."""


Command = Home | Move | Grasp
Request = Open | State | Command | Stop


@dataclass(frozen=True)
class Done:
    """The answer if the request succeeded."""

    state: HandState


@dataclass(frozen=True)
class NotDone:
    """The answer if it failed: HandError, or DeviceUnavailable if the hand is lost."""

    text: str
    lost: bool = False


@dataclass(frozen=True)
class Stopped:
    """The answer to a command that was stopped."""

    why: str  # a value of `hw.watchdog.WHY`, SILENT or ORPHANED
    after_s: float  # from the request to stop until the hand accepted it


Answer = Done | NotDone | Stopped
