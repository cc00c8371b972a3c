"""For the doctor: an arm's state over FCI, and how evenly its states arrive. Nothing moves."""

from __future__ import annotations

from dataclasses import dataclass

from hw.errors import DeviceUnavailable
from hw.franka.driver import Failure, Reading
from hw.franka.messages import Rhythm, Timing
from hw.franka.process import PlayerProcess
from hw.franka.settings import FrankaSettings

STATES = 1000
"""States to take: one second of them."""


@dataclass(frozen=True)
class Inspection:
    """The findings about a connected arm."""

    reading: Reading
    rhythm: Rhythm
    notes: tuple[str, ...]  # real-time properties that the computer denies the player


def inspect(model: str, settings: FrankaSettings, *, realtime: bool, states: int = STATES) -> Inspection:
    """Connect, read mode and joints, and take `states` states at 1 kHz. Nothing moves, and no setting changes.

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
