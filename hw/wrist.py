"""The looks of hand, fingers and link 7: tight convex shapes from the outer dimensions of the maker's meshes.

They are drawn into pictures and compared with them. Clearances are computed with `hw.outline`, which contains the
meshes.
"""

from __future__ import annotations

import numpy as np

from hw.types import Array, frozen_array

_S = float(np.sqrt(0.5))

X_FH: Array = frozen_array([[_S, _S, 0.0, 0.0], [-_S, _S, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(4, 4) the hand in the flange: its fingers open along its Y axis, its Z axis is the flange's."""

FINGERTIP_M = 0.1123
"""Distance of the fingers' ends from the flange: the finger's joint at 0.0584 m, its mesh 0.0539 m long."""

_LINK7_TO_FLANGE_M = 0.107


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Array:
    """(8, 3) corners, hand to flange."""
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    return frozen_array(corners @ X_FH[:3, :3].T)


def _disc(radius_m: float, low_m: float, high_m: float) -> Array:
    """(48, 3) both rims of a cylinder about the flange's axis."""
    turn = 2.0 * np.pi * np.arange(24) / 24
    ring = radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return frozen_array(np.concatenate([np.column_stack([ring, np.full(24, z)]) for z in (low_m, high_m)]))


HAND_BODY: tuple[Array, ...] = (
    _box((-0.023, -0.101, -0.005), (0.023, 0.101, 0.066)),
    _box((-0.007, -0.103, -0.026), (0.007, -0.045, -0.005)),
)
"""Convex parts of the hand, each (n, 3) in the flange: the body, and the plug of its cable."""

FINGERS: tuple[Array, ...] = (_box((-0.011, -0.030, 0.058), (0.011, 0.030, FINGERTIP_M)),)
"""The closed fingers, in the flange."""

LINK7: tuple[Array, ...] = (
    _disc(0.046, 0.030 - _LINK7_TO_FLANGE_M, 0.090 - _LINK7_TO_FLANGE_M),
    _disc(0.0315, 0.090 - _LINK7_TO_FLANGE_M, 0.0),
)
"""Link 7 without its buttons, in the flange."""
