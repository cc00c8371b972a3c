"""A motion of the lab's plant: its positions over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array


@dataclass(frozen=True, eq=False)
class PlantMotion:
    """Positions of the whole plant, and of the arm in it, over time."""

    t_s: Array  # (M,) increasing
    positions: Array  # (M, nq)
    q_rad: Array  # (M, 7)

    def at(self, times_s: Array) -> Array:
        """Plant positions (S, nq) at `times_s` (S,): linear in between, constant beyond the ends.

        Quaternions are interpolated by component, which is exact enough between samples a few milliseconds apart.
        """
        return np.stack([np.interp(times_s, self.t_s, column) for column in self.positions.T], axis=-1)

    def arm_at(self, times_s: Array) -> Array:
        """Joint positions (S, 7) at `times_s` (S,)."""
        return np.stack([np.interp(times_s, self.t_s, column) for column in self.q_rad.T], axis=-1)


class DivergedError(Exception):
    """The solver gave up; `motion` is the motion until then."""

    def __init__(self, t_s: float, reason: str, motion: PlantMotion) -> None:
        super().__init__(f"the lab's simulation failed {t_s:.3f} s into the path: {reason}")
        self.motion = motion
