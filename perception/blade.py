"""The blade of the spatula in its tool frame T, and when a piece lies on it.

Cameras and simulations share this rule.
"""

from __future__ import annotations

from hw.types import Array

BLADE_LENGTH_M, BLADE_WIDTH_M = 0.10, 0.08
"""The blade's face in T: x from -length to 0, |y| up to half the width, at z = 0."""

BEHIND_M = 0.010
"""How far behind the root of the blade a piece may lie (m): the neck of the tool holds it there."""

ABOVE_FACE_M = 0.001
"""The centre of a piece on the blade is higher than this above the blade's face (m)."""


def is_on_blade(p_TO_m: Array) -> bool:
    """Whether a piece with its centre at (3,) in T lies on the face, or is held by the neck behind it."""
    x_m, y_m, z_m = p_TO_m
    return bool(z_m > ABOVE_FACE_M and -BLADE_LENGTH_M - BEHIND_M <= x_m <= 0.0 and abs(y_m) <= BLADE_WIDTH_M / 2)
