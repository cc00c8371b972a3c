"""The rest pose of a soft piece on a rigid table, with the depth to which it sinks in under its own weight."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.tasks.scooping.piece import Piece

GRAVITY_M_S2 = 9.81
_CELLS = 12
_STEPS = 14


def sink_m(piece: Piece, mass_kg: float, e_Pa: float) -> float:
    """Depth at which hydroelastic pressure, e (1 - gauge) over the slice at table height, carries the weight.

    The gauge is 1 on the surface and 0 at the centre (Drake's field of a convex piece). Bisection on a grid over a
    quarter of the slice: the pieces are symmetric.
    """
    corners = piece.vertices_m[piece.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    planes = normals / np.einsum("fi,fi->f", normals, corners[:, 0])[:, None]  # gauge(p) = max over planes . p
    half_m = piece.vertices_m.max(axis=0)
    x, y = (half * (np.arange(_CELLS) + 0.5) / _CELLS for half in half_m[:2])
    flat = (planes[:, 0, None, None] * x[:, None] + planes[:, 1, None, None] * y).reshape(len(planes), -1)
    cell_m2 = 4.0 * half_m[0] * half_m[1] / _CELLS**2
    low, high = 0.0, float(half_m[2])
    for _ in range(_STEPS):
        middle = (low + high) / 2.0
        gauge = (flat - planes[:, 2, None] * (half_m[2] - middle)).max(axis=0)
        force_N = e_Pa * np.maximum(1.0 - gauge, 0.0).sum() * cell_m2
        low, high = (middle, high) if force_N < mass_kg * GRAVITY_M_S2 else (low, middle)
    return (low + high) / 2.0


def lying(context: Array, height_m: float) -> Array:
    """(4, 4) pose of the piece with its centre `height_m` over the table at `context` (x, y)."""
    X_BO = np.eye(4)
    X_BO[:3, 3] = [context[0], context[1], height_m]
    return X_BO
