"""Coloured meshes for the camera: patch, bottle and printed pusher."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.tasks.pushing.mount import (
    BLOCK_M,
    GRIP_M,
    PLATE_HEIGHT_M,
    PLATE_THICKNESS_M,
    PLATE_WIDTH_M,
    ROOT_M,
    STEM_M,
    block_axes,
)
from sim.tasks.pushing.params import BASE_HEIGHT_M, BASE_RADIUS_M, BOTTLE_HEIGHT_M, BOTTLE_RADIUS_M
from sim.tasks.shared.shapes import Shape, box, turned_body
from sim.types import Visual

_PRINT = (0.02, 0.05, 0.16)
_FELT = (0.03, 0.20, 0.07)
_BOTTLE = (0.70, 0.68, 0.62)
_FELT_M = 3e-4  # drawn this much above the table; in physics it is flush
_SIDES = 32


def patch_visual(x_m: tuple[float, float], y_m: tuple[float, float]) -> Visual:
    """The patch on the table, over the given ranges of x and y."""
    size, centre = np.array([x_m[1] - x_m[0], y_m[1] - y_m[0], _FELT_M]), np.array([sum(x_m), sum(y_m), _FELT_M]) / 2
    return Visual("world", *box(size, centre), _FELT)


def bottle_visual(body: str) -> Visual:
    """The bottle: its base, and above it the band."""
    half_m = BOTTLE_HEIGHT_M / 2
    seam_m = BASE_HEIGHT_M - half_m
    outline = np.array(
        [
            [BASE_RADIUS_M, -half_m],
            [BASE_RADIUS_M, seam_m],
            [BOTTLE_RADIUS_M, seam_m],
            [BOTTLE_RADIUS_M, half_m],
        ]
    )
    return Visual(body, *turned_body(outline, _SIDES), _BOTTLE)


def pusher_visuals(body: str) -> tuple[Visual, ...]:
    """Plate, stem and the block that the fingers hold, in the tool frame."""
    size_m = np.array([PLATE_THICKNESS_M, PLATE_WIDTH_M, PLATE_HEIGHT_M])
    plate = box(size_m, np.array([-PLATE_THICKNESS_M, 0.0, PLATE_HEIGHT_M]) / 2)
    along = (GRIP_M - ROOT_M) / np.linalg.norm(GRIP_M - ROOT_M)
    beside = np.cross([0.0, 0.0, 1.0], along) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], along))
    length_m = float(np.linalg.norm(GRIP_M - ROOT_M))
    stem = _turned(
        np.column_stack([along, beside, np.cross(along, beside)]),
        np.array([length_m, STEM_M, STEM_M]),
        (ROOT_M + GRIP_M) / 2,
    )
    block = _turned(block_axes(), np.array(BLOCK_M), GRIP_M)
    return tuple(Visual(body, *shape, _PRINT) for shape in (plate, stem, block))


def _turned(R: Array, size_m: Array, centre_m: Array) -> Shape:
    """A box along the axes that are the columns of `R` (3, 3)."""
    vertices_m, triangles = box(size_m, np.zeros(3))
    return vertices_m @ R.T + centre_m, triangles
