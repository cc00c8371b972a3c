"""The pixels that a body can cover. Rays are cast through these only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from sim.render.rays import NEAR_M, image_rectangle, pixels

_MARGIN_PX, _BENT_PX = 3.0, 140.0
"""Margin around a hull: rays do not pass exactly through the pixel centres, and the lens bends straight edges.

A Kinect bends an edge of `_BENT_PX` pixels by at most 1 px; the bend grows with the square of the length.
"""


@dataclass(frozen=True, eq=False)
class Outline:
    """Pixel coordinates (n,), row by row."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]


def outline(points_m: Array, parts: Sequence[slice], camera: Intrinsics, fov: tuple[Array, Array]) -> Outline:
    """The pixels that a body can cover, given that each of its parts lies in the convex hull of that part's points.

    `points_m` (S, N, 3) are in the camera's frame, at S moments of one exposure; `parts` are slices of N. `fov` comes
    from `field_of_view`.
    """
    around = image_rectangle(points_m.reshape(-1, 3), camera, fov)
    (top, bottom), (left, right) = ((side.start, side.stop) for side in around)
    mask = np.zeros((max(bottom - top, 0), max(right - left, 0)), dtype=np.uint8)
    if points_m[..., 2].min() < NEAR_M:
        mask[:] = 1
    elif mask.size:
        xy = points_m[..., :2] / points_m[..., 2:]
        inside = np.all((xy >= fov[0]) & (xy <= fov[1]), axis=(0, 2))
        uv = pixels(np.clip(xy, *fov).reshape(-1, 2), camera).reshape(xy.shape) - [left, top]
        for part in parts:
            _fill(mask, np.round(uv[:, part].reshape(-1, 2)).astype(np.int32), bool(np.all(inside[part])))
    rows, columns = np.nonzero(mask)
    return Outline(rows + top, columns + left)


def _fill(mask: NDArray[np.uint8], corners: NDArray[np.int32], straight: bool) -> None:
    """Fill the hull of corners (n, 2) in the mask, or their bounding rectangle where the hull may not be `straight`."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    around = np.array([low, [low[0], high[1]], high, [high[0], low[1]]])
    hull = cv2.convexHull(corners) if straight else around
    length = float(np.linalg.norm(high - low))
    cv2.fillConvexPoly(mask, hull, 1)
    cv2.polylines(mask, [hull], True, 1, 1 + 2 * int(np.ceil(_MARGIN_PX + (length / _BENT_PX) ** 2)))
