"""Pictures printed on flat parts of a body."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.render.rays import Array32
from sim.types import Texture

_ON_PLANE_M = 1e-4


def paint(texture: Texture, points_m: Array, albedo: Array32) -> Array32:
    """`albedo` (n, 3) of surface points (n, 3) in the body's frame -> the same with the picture painted on.

    Bilinear between texel centres, so that edges keep their place to a fraction of a texel.
    """
    R, origin = texture.X_OP[:3, :3], texture.X_OP[:3, 3]
    place = (points_m - origin) @ R
    rows, columns = texture.albedo.shape
    u = place[:, 0] / texture.size_m[0] * columns - 0.5
    v = place[:, 1] / texture.size_m[1] * rows - 0.5
    on_it = (np.abs(place[:, 2]) < _ON_PLANE_M) & (np.abs(u - (columns - 1) / 2) <= columns / 2)
    on_it &= np.abs(v - (rows - 1) / 2) <= rows / 2
    u, v = np.clip(u[on_it], 0, columns - 1.001), np.clip(v[on_it], 0, rows - 1.001)
    left, top = u.astype(int), v.astype(int)
    a, b = u - left, v - top
    grey = texture.albedo
    upper = (1 - a) * grey[top, left] + a * grey[top, left + 1]
    lower = (1 - a) * grey[top + 1, left] + a * grey[top + 1, left + 1]
    painted = albedo.copy()
    painted[on_it] = ((1 - b) * upper + b * lower)[:, None]
    return painted
