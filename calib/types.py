"""The result of a camera-to-base calibration."""

from __future__ import annotations

from dataclasses import dataclass

from hw.types import Array, frozen_array


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where the fixed colour camera stands in the robot base frame, and how well that is known."""

    X_BC: Array  # (4, 4)
    sigma_mm: float  # one standard deviation of the position
    sigma_deg: float  # one standard deviation of the rotation
    source: str  # where it comes from, in words
    created: str  # ISO 8601 date, "" where not known

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_BC", frozen_array(self.X_BC, (4, 4), "X_BC"))
