"""Lighting: two distant lamps, a soft sky, Lambert's cosine, and a wooden table top."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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


def _unit(x: float, y: float, z: float) -> Array:
    v = np.array([x, y, z])
    unit: Array = v / np.linalg.norm(v)
    return unit


KEY_LIGHT = _unit(0.45, -0.50, 1.05)
"""Direction towards the lamp that casts shadows, in the base frame."""
FILL_LIGHT = _unit(0.55, 0.75, 0.60)
KEY_POWER, FILL_POWER, SKY_POWER, FLOOR_POWER = 0.62, 0.16, 0.40, 0.14
SHADOW_SHARE = 0.52
"""The light removed by a full shadow of the key light."""
BACKGROUND_RGB = np.array([0.20, 0.21, 0.23], dtype=np.float32)
"""Background colour of rays that leave the scene, linear."""


def light(normal: Array32) -> Array32:
    """(n, 1) light on matte surfaces with unit normals (n, 3) in the base frame, without shadows."""
    key = KEY_POWER * np.maximum(normal @ KEY_LIGHT.astype(np.float32), 0)
    fill = FILL_POWER * np.maximum(normal @ FILL_LIGHT.astype(np.float32), 0)
    up = np.float32(0.5) * (normal[:, 2] + 1)
    return np.asarray(key + fill + FLOOR_POWER + (SKY_POWER - FLOOR_POWER) * up, dtype=np.float32)[:, None]


def lit_by_key(normal: Array32) -> NDArray[np.bool_]:
    """(n,) whether the key light reaches surfaces with these normals."""
    lit: NDArray[np.bool_] = normal @ KEY_LIGHT.astype(np.float32) > 0.02
    return lit


def grain(points_m: Array32) -> Array32:
    """(n, 1) brightness of a wooden top, about 1, at points (n, 3) of the base frame: long fibres along Y."""
    x, y = points_m[:, 0], points_m[:, 1]
    bend = 0.010 * np.sin(7.0 * y + 1.3) + 0.004 * np.sin(19.0 * y + 31.0 * x)
    rings = np.sin(2 * np.pi * (x + bend) / 0.047) + 0.6 * np.sin(2 * np.pi * (x + 1.7 * bend) / 0.0193 + 1.1)
    fibre = 0.5 * np.sin(2 * np.pi * (x / 0.0061 + 0.35 * np.sin(11.0 * y)))
    boards = np.sin(12.9898 * np.floor((x - 0.02) / 0.145)) * 0.8
    return np.asarray(1.0 + 0.030 * (rings + fibre + boards), dtype=np.float32)[:, None]


_SRGB_STEPS = 4096


def _srgb_table() -> NDArray[np.uint8]:
    linear = np.linspace(0, 1, _SRGB_STEPS)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded).astype(np.uint8)


_SRGB = _srgb_table()


def srgb(linear: Array32) -> NDArray[np.uint8]:
    """Linear radiance, 1 = white -> 8-bit sRGB (IEC 61966-2-1)."""
    steps = linear * np.float32(_SRGB_STEPS - 1)
    steps += np.float32(0.5)
    encoded: NDArray[np.uint8] = _SRGB.take(np.clip(steps, 0, _SRGB_STEPS - 1, out=steps).astype(np.intp))
    return encoded
