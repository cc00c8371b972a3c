"""What an arm says of itself over FCI, and how evenly its states come, without a motion: for the doctor."""

from __future__ import annotations

from dataclasses import dataclass

from hw.errors import DeviceUnavailable
from hw.franka.driver import Failure, Reading
from hw.franka.messages import Rhythm, Timing
from hw.franka.process import PlayerProcess
from hw.franka.settings import FrankaSettings

STATES = 1000
"""One second."""


@dataclass(frozen=True)
class Inspection:
    """One look at a connected arm."""

    reading: Reading
    rhythm: Rhythm
    notes: tuple[str, ...]  # what the computer does not give the player


def inspect(model: str, settings: FrankaSettings, *, realtime: bool, states: int = STATES) -> Inspection:
    """Connect, read mode and joints, and take so many states at 1 kHz. Nothing moves, no setting is made.

    `realtime` as far as the kernel permits it. Raises DeviceUnavailable.
    """
    try:
        player = PlayerProcess(model, settings, Timing(realtime=realtime))
    except Failure as failure:
        raise DeviceUnavailable(failure.text) from failure
    try:
        return Inspection(player.reading(), player.listen(states), player.notes)
    except Failure as failure:
        raise DeviceUnavailable(failure.text) from failure
    finally:
        player.close()
