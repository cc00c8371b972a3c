"""Chooses among actions that look equal the one whose surroundings are good as well.

Over all of Omega many actions earn the same in simulation, and the solver's choice among them is arbitrary, often at an
end of the ranges. Reality differs from every simulator, and this difference acts like a change of the action. So an
action is safer if its neighbours also earn much. Beyond the ranges nothing is known, and the outside counts as a
failure. The rule uses only the simulator.
"""

from __future__ import annotations

import numpy as np

from hw.types import Array

ALIKE = 0.02
"""Actions whose value is at most this far below the best count as equally good."""

LENGTH = 0.2
"""Standard deviation of the surroundings, in fractions of the ranges."""


def prefer_interior(points: Array, worth: Array, even: Array, even_worth: Array) -> Array:
    """(A,) values for choosing among `points` (A, a) with the values `worth` (A,). Actions that look equal to the best
    one come first, ordered by the mean value of their surroundings.

    `even` (C, a) fill the unit box evenly and have the values `even_worth` (C,).
    """
    squared = ((points[:, None] - even[None]) ** 2).sum(axis=-1)
    whole = len(even) * (2.0 * np.pi * LENGTH**2) ** (points.shape[1] / 2.0)
    around = np.exp(-0.5 * squared / LENGTH**2) @ np.maximum(even_worth, 0.0) / whole
    is_alike = worth >= worth.max() - ALIKE
    return np.where(is_alike, worth.max() + around, worth)
