"""The lab's bench, as `hw.ports.Bench`: a person with a steady but imperfect hand."""

from __future__ import annotations

from hw.placing import Placing
from hw.types import Array
from sim.lab.room import Room


class LabBench:
    """Moves the arm home, then places the object near the wanted place."""

    def __init__(self, room: Room) -> None:
        self._room = room

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """See `hw.ports.Bench`."""
        asked = Placing(xy_m, trial, attempt)
        self._room.place(asked.xy_m, asked.trial, asked.attempt)
