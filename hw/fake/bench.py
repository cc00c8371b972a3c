"""A bench that only remembers what it was asked for."""

from __future__ import annotations

from dataclasses import dataclass

from hw.types import Array, frozen_array


@dataclass(frozen=True, eq=False)
class Placing:
    """One request."""

    xy_m: Array  # (2,)
    trial: int
    attempt: int


class FakeBench:
    """`placed` holds every request, oldest first."""

    def __init__(self) -> None:
        self.placed: list[Placing] = []

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        self.placed.append(Placing(frozen_array(xy_m, (2,), "xy_m"), trial, attempt))
