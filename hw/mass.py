"""Mass, centre of mass and inertia of a rigid body in one frame; bodies can be added."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hw.types import REACH_M, Array, frozen_array, number

HEAVIEST_KG = 100.0
"""No link or load of these arms is heavier."""


@dataclass(frozen=True, eq=False)
class Mass:
    """The mass of a rigid body, in a frame that the owner names."""

    kg: float
    com_m: Array  # (3,) centre of mass
    inertia_kg_m2: Array  # (3, 3) about the centre of mass

    def __post_init__(self) -> None:
        """Raises ValueError for a negative mass or an impossible inertia."""
        number(self.kg, "mass", 0.0, HEAVIEST_KG, "kg")
        object.__setattr__(self, "com_m", frozen_array(self.com_m, (3,), "centre of mass", most=REACH_M))
        object.__setattr__(self, "inertia_kg_m2", inertia(self.inertia_kg_m2, "inertia"))

    def placed(self, X: Array) -> Mass:
        """The same body in another frame; `X` (4, 4) is the pose of its present frame there."""
        R = X[:3, :3]
        inertia = R @ self.inertia_kg_m2 @ R.T
        return Mass(self.kg, R @ self.com_m + X[:3, 3], (inertia + inertia.T) / 2.0)

    def __add__(self, other: Mass) -> Mass:
        """The two bodies as one, by the parallel axis theorem."""
        kg = self.kg + other.kg
        if kg == 0.0:
            return self
        com_m = (self.kg * self.com_m + other.kg * other.com_m) / kg
        return Mass(kg, com_m, self._about(com_m) + other._about(com_m))

    def _about(self, p_m: Array) -> Array:
        off = self.com_m - p_m
        return np.asarray(self.inertia_kg_m2 + self.kg * (off @ off * np.eye(3) - np.outer(off, off)))


def inertia(value: ArrayLike, name: str) -> Array:
    """(3, 3) kg m² about the centre of mass. Raises ValueError for an inertia that no body has."""
    matrix = frozen_array(value, (3, 3), name, most=HEAVIEST_KG * REACH_M**2)
    if np.abs(matrix - matrix.T).max() > 1e-9 or np.linalg.eigvalsh(matrix).min() < -1e-12:
        raise ValueError(
            f"{name} {matrix.tolist()} kg m²: it must be symmetric and not negative; take it from the drawing of the "
            "body, about its centre of mass"
        )
    return matrix


NOTHING = Mass(0.0, np.zeros(3), np.zeros((3, 3)))
"""The load of an empty hand."""


def box(kg: float, size_m: ArrayLike, centre_m: ArrayLike) -> Mass:
    """A homogeneous box with edges `size_m` (3,) along the axes, centred at `centre_m` (3,)."""
    squares = np.square(np.asarray(size_m, dtype=np.float64))
    return Mass(kg, np.asarray(centre_m), np.diag(kg / 12.0 * (squares.sum() - squares)))


def bar(kg: float, start_m: ArrayLike, end_m: ArrayLike, edge_m: float) -> Mass:
    """A homogeneous bar from `start_m` (3,) to `end_m` (3,), with a square cross section of edge `edge_m`."""
    start, end = np.asarray(start_m, dtype=np.float64), np.asarray(end_m, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    along = np.outer(end - start, end - start) / length**2
    across = kg / 12.0 * (length**2 + edge_m**2)
    return Mass(kg, (start + end) / 2.0, across * (np.eye(3) - along) + kg / 6.0 * edge_m**2 * along)
