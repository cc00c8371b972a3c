"""A request to put the object on the table, checked: the same for a person, the lab and the fake bench."""

from __future__ import annotations

from dataclasses import dataclass

from hw.types import Array, frozen_array


@dataclass(frozen=True, eq=False)
class Placing:
    """The wanted place of the object, for an attempt of a trial. Raises ValueError."""

    xy_m: Array  # (2,) in the base frame
    trial: int  # from 1
    attempt: int  # from 0: how often the operator has redone the trial

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", frozen_array(self.xy_m, (2,), "xy_m"))
        if self.trial < 1 or self.attempt < 0:
            raise ValueError(f"trial {self.trial}, attempt {self.attempt}: trials are numbered from 1, attempts from 0")
