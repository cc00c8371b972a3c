"""Poses, rays, image rectangles, and the pixels that a body can cover. Rays are cast through these only."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from perception.geometry import interpolation

STILL = 5e-6
"""Tolerance in m, and in rad over 0.2 m: 1/300 of a pixel of the lab's camera."""


def held_still(X: Array) -> Array:
    """Poses (S, 4, 4) over time -> the same, but a pose within `STILL` of an earlier one becomes that one.

    A body at rest moves by nanometres; a renderer needs only one picture of a body that does not move.
    """
    held = X.copy()
    for i in range(1, len(held)):
        if np.abs(held[i] - held[i - 1]).max() <= STILL:
            held[i] = held[i - 1]
    return held


def holds_still(X: Array) -> bool:
    """Whether poses (S, 4, 4) are all the same."""
    return not np.ptp(X, axis=0).any()


def within_exposure(X: Array, fractions: Array) -> Array:
    """Poses (S, 4, 4) at the middles of S equal slices of an exposure -> (K, 4, 4) at `fractions` (K,) in [0, 1].

    Linear interpolation (rotations are orthonormalised), held beyond the first and last slice. A body that holds still
    is not interpolated: its poses stay exactly equal.
    """
    if holds_still(X):
        X = X[:1]
    count = len(X)
    place = np.clip(fractions * count - 0.5, 0, count - 1)
    lower = np.minimum(place.astype(int), max(count - 2, 0))
    upper = np.minimum(lower + 1, count - 1)
    weight = (place - lower)[:, None, None]
    mixed: Array = (1 - weight) * X[lower] + weight * X[upper]
    u, _, vt = np.linalg.svd(mixed[:, :3, :3])
    mixed[:, :3, :3] = u @ vt
    return mixed


Rectangle = tuple[slice, slice]


def is_empty(box: Rectangle) -> bool:
    """Whether the rectangle has no pixel."""
    rows, columns = box
    return bool(rows.stop <= rows.start or columns.stop <= columns.start)


def union(boxes: Sequence[Rectangle]) -> Rectangle | None:
    """The smallest rectangle around all non-empty ones; None if all are empty."""
    full = [box for box in boxes if not is_empty(box)]
    if not full:
        return None
    rows, columns = zip(*full, strict=True)
    return (
        slice(min(s.start for s in rows), max(s.stop for s in rows)),
        slice(min(s.start for s in columns), max(s.stop for s in columns)),
    )


def within(box: Rectangle, region: Rectangle) -> Rectangle:
    """The part of `box` inside `region`, in pixels from the first corner of `region`."""
    rows, columns = (
        slice(max(side.start - whole.start, 0), max(min(side.stop, whole.stop) - whole.start, 0))
        for side, whole in zip(box, region, strict=True)
    )
    return rows, columns


def coarser(box: Rectangle, step: int) -> Rectangle:
    """`box` in an image reduced to every `step`-th row and column."""
    rows, columns = box
    return slice(rows.start // step, -(-rows.stop // step)), slice(columns.start // step, -(-columns.stop // step))


Array32 = NDArray[np.float32]

_NODES = 32
NEAR_M = 0.02
_MARGIN_PX, _BENT_PX = 3, 140.0
"""Margin around a projection, because rays do not pass exactly through the pixel centres, and the lens bends straight
edges.

A Kinect bends an edge of `_BENT_PX` pixels by at most 1 px; the bend grows with the square of the length."""
_FOV_MARGIN = 1.05  # the distortion polynomial is not trusted beyond the corners of the image


def pixel_rays(camera: Intrinsics) -> Array32:
    """(H, W, 3) undistorted directions with z = 1 through the pixel centres (within 2e-3 px).

    They are undistorted to convergence at the nodes of a Chebyshev grid, and interpolated by its polynomial.
    """
    to_row, row_nodes = interpolation(slice(0, camera.height), _NODES)
    to_column, column_nodes = interpolation(slice(0, camera.width), _NODES)
    nodes = np.stack(np.meshgrid(column_nodes, row_nodes), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    exact = cv2.undistortPointsIter(nodes, camera.K, camera.distortion, np.eye(3), np.eye(3), criteria)
    grid = exact.reshape(len(row_nodes), len(column_nodes), 2)
    rays = np.ones((camera.height, camera.width, 3), dtype=np.float32)
    for axis in range(2):
        rays[..., axis] = to_row @ grid[..., axis] @ to_column.T
    return rays


def shift_rays(rays: Array32, du: float, dv: float) -> Array32:
    """`rays` through points (du, dv) px beside the pixel centres, to first order."""
    by_row, by_column = np.gradient(rays[..., :2], axis=(0, 1))
    moved = rays.copy()
    moved[..., :2] += np.float32(du) * by_column + np.float32(dv) * by_row
    return moved


def field_of_view(rays: Array32) -> tuple[Array, Array]:
    """Lowest and highest x, y of `rays` (H, W, 3), with a small margin."""
    xy = rays[..., :2].astype(np.float64)
    return xy.min(axis=(0, 1)) * _FOV_MARGIN, xy.max(axis=(0, 1)) * _FOV_MARGIN


def pixels(xy: Array, camera: Intrinsics) -> Array:
    """Column and row (N, 2) in the image of the rays through `xy` (N, 2) at z = 1."""
    ahead = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
    uv, _ = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    return np.asarray(uv.reshape(-1, 2), dtype=np.float64)


def image_rectangle(points_m: Array, camera: Intrinsics, fov: tuple[Array, Array]) -> Rectangle:
    """Rows and columns that hold the projection of `points_m` (N, 3), given in the camera frame.

    `fov` is the `field_of_view` of the camera. A point behind or beside the camera extends the rectangle to the whole
    image.
    """
    everything = (slice(0, camera.height), slice(0, camera.width))
    z = points_m[:, 2]
    if z.min() < NEAR_M:
        return everything
    uv = pixels(np.clip(points_m[:, :2] / z[:, None], *fov), camera)
    first = np.floor(uv.min(axis=0)).astype(int) - _MARGIN_PX
    last = np.ceil(uv.max(axis=0)).astype(int) + _MARGIN_PX + 1
    size = np.array([camera.width, camera.height])
    first, last = np.clip(first, 0, size), np.clip(last, 0, size)
    return slice(int(first[1]), int(last[1])), slice(int(first[0]), int(last[0]))


Pixels = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows (n,) and columns (n,), row by row."""


def through(pixels: Pixels, rays: Array32) -> Array32:
    """(n, 3) the directions of `rays` (H, W, 3) through pixels."""
    directions: Array32 = rays.reshape(-1, 3).take(np.ravel_multi_index(pixels, rays.shape[:2]), axis=0)
    return directions


def outline(points_m: Array, parts: Sequence[slice], camera: Intrinsics, fov: tuple[Array, Array]) -> Pixels:
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
    return rows + top, columns + left


def _fill(mask: NDArray[np.uint8], corners: NDArray[np.int32], straight: bool) -> None:
    """Fill the hull of corners (n, 2) in the mask, or their bounding rectangle where the hull may not be `straight`."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    around = np.array([low, [low[0], high[1]], high, [high[0], low[1]]])
    hull = cv2.convexHull(corners) if straight else around
    length = float(np.linalg.norm(high - low))
    cv2.fillConvexPoly(mask, hull, 1)
    cv2.polylines(mask, [hull], True, 1, 1 + 2 * int(np.ceil(_MARGIN_PX + (length / _BENT_PX) ** 2)))
