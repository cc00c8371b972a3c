"""A bench that only records its requests."""

from __future__ import annotations

from hw.types import Array, Placing


class FakeBench:
    """`placed` holds every request, oldest first."""

    def __init__(self) -> None:
        self.placed: list[Placing] = []

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """See `hw.ports.ObjectPlacer`."""
        self.placed.append(Placing(xy_m, trial, attempt))
