"""The lab's bench, as `hw.ports.Bench`: someone with a steady, but not a perfect, hand."""

from __future__ import annotations

from hw.placing import Placing
from hw.types import Array
from sim.lab.room import Room


class LabBench:
    """Puts the object down near where it is asked to, and walks the arm home first."""

    def __init__(self, room: Room) -> None:
        self._room = room

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """See `hw.ports.Bench`."""
        asked = Placing(xy_m, trial, attempt)
        self._room.place(asked.xy_m, asked.trial, asked.attempt)
