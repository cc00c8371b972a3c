"""The lab's bench, as `hw.ports.Bench`: someone with a steady, but not a perfect, hand."""

from __future__ import annotations

from hw.types import Array, frozen_array
from sim.lab.room import Room


class LabBench:
    """Puts the object down near where it is asked to, and walks the arm home first."""

    def __init__(self, room: Room) -> None:
        self._room = room

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """See `hw.ports.Bench`. Raises ValueError for a trial under 1 or an attempt under 0."""
        if trial < 1 or attempt < 0:
            raise ValueError(f"trial {trial}, attempt {attempt}: trials count from 1 and attempts from 0")
        self._room.place(frozen_array(xy_m, (2,), "xy_m"), trial, attempt)
