"""Cameras in the base frame: projection, and the undistorted rays of a part of an image.

Image coordinates here are "ideal pixels": normalised coordinates (x / z, y / z) times the focal length, so that
a pixel keeps its size and no distortion is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, Intrinsics

Array32 = NDArray[np.float32]
Area = tuple[float, float, float, float]
"""x_low, x_high, y_low, y_high in the base frame, metres."""

_UNDISTORT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
_NODES = 7


def transform(X_AB: Array, points_B_m: Array) -> Array:
    """(..., 3) points of frame B in frame A."""
    moved: Array = points_B_m @ X_AB[:3, :3].T + X_AB[:3, 3]
    return moved


def project(camera: Intrinsics, X_VB: Array, points_B_m: Array) -> Array:
    """(N, 3) points of the base frame -> (N, 2) pixels of a camera V, distortion included."""
    local = transform(X_VB, np.atleast_2d(points_B_m))
    uv, _ = cv2.projectPoints(local, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    return np.asarray(uv, dtype=np.float64).reshape(-1, 2)


def scaled(camera: Intrinsics, scale: float) -> Intrinsics:
    """The camera with its pictures scaled."""
    K = camera.K.copy()
    K[:2] *= scale
    K[:2, 2] += 0.5 * scale - 0.5  # pixel centres at integers
    return Intrinsics(round(camera.width * scale), round(camera.height * scale), K, camera.distortion)


def position_in_words(xy_m: Array) -> str:
    """A place (2,) on the table in words, as the robot sees it: 558 mm ahead, 2 mm left."""
    return f"{1e3 * xy_m[0]:.0f} mm ahead, {1e3 * abs(xy_m[1]):.0f} mm {'left' if xy_m[1] > 0 else 'right'}"


def on_plane(directions: Array, X_BV: Array, height_m: float) -> Array:
    """Where rays (N, 3) of camera V meet the plane z = `height_m` of the base frame -> (N, 2)."""
    along = directions @ X_BV[:3, :3].T
    t = (height_m - X_BV[2, 3]) / along[:, 2]
    met: Array = (X_BV[:3, 3] + t[:, None] * along)[:, :2]
    return met


@dataclass(frozen=True, eq=False)
class ImageRegion:
    """A rectangle of one camera's image."""

    camera: Intrinsics
    X_BV: Array  # (4, 4) the camera in the base frame
    rows: slice
    columns: slice

    @cached_property
    def X_VB(self) -> Array:
        """(4, 4) the base in the camera."""
        return inverse(self.X_BV)

    @cached_property
    def focal_px(self) -> float:
        """Geometric mean of both axes."""
        return float(np.sqrt(self.camera.K[0, 0] * self.camera.K[1, 1]))

    @cached_property
    def xy(self) -> Array32:
        """(h, w, 2) ideal pixels: exact on a few nodes, a polynomial in between (within 0.01 px)."""
        to_row, row_nodes = interpolation(self.rows)
        to_column, column_nodes = interpolation(self.columns)
        nodes = np.stack(np.meshgrid(column_nodes, row_nodes), axis=-1).reshape(-1, 1, 2)
        camera = self.camera
        exact = cv2.undistortPointsIter(nodes, camera.K, camera.distortion, np.eye(3), np.eye(3), _UNDISTORT)
        grid = self.focal_px * exact.reshape(len(row_nodes), len(column_nodes), 2)
        xy: Array32 = np.einsum("hi,ijk,wj->hwk", to_row, grid, to_column, optimize=True).astype(np.float32)
        return xy

    @cached_property
    def directions(self) -> Array32:
        """(h * w, 3) rays with z = 1 in the camera's frame."""
        xy = self.xy.reshape(-1, 2) / np.float32(self.focal_px)
        return np.concatenate([xy, np.ones((len(xy), 1), dtype=np.float32)], axis=1)

    def image_point(self, points_B_m: Array) -> Array:
        """(N, 3) points of the base frame -> (N, 2) ideal pixels."""
        local = transform(self.X_VB, points_B_m)
        uv: Array = self.focal_px * local[:, :2] / local[:, 2:]
        return uv

    def depth_of(self, point_B_m: Array) -> float:
        """Distance of a point (3,) of the base frame along the optical axis."""
        return float(transform(self.X_VB, point_B_m)[2])

    def window(self, centre_B_m: Array, reach_m: float) -> ImageRegion | None:
        """The part of this view around a point of the base frame; None if it lies outside."""
        depth_m = self.depth_of(centre_B_m)
        if depth_m < 0.05:
            return None
        half = int(np.ceil(reach_m * self.focal_px / depth_m)) + 1
        u, v = (int(x) for x in np.rint(project(self.camera, self.X_VB, centre_B_m)[0]))
        rows = slice(max(v - half, self.rows.start), min(v + half + 1, self.rows.stop))
        columns = slice(max(u - half, self.columns.start), min(u + half + 1, self.columns.stop))
        if rows.stop - rows.start < 4 or columns.stop - columns.start < 4:
            return None
        return ImageRegion(self.camera, self.X_BV, rows, columns)

    def sample(self, picture: Array32, points_B_m: Array) -> Array32:
        """(n,) value of `picture` (h, w) of this view where points (n, 3) of the base frame appear; 0 outside."""
        ideal = self.image_point(points_B_m)
        first, last = self.xy[0, 0], self.xy[-1, -1]
        height, width = picture.shape
        u = np.rint((ideal[:, 0] - first[0]) * (width - 1) / (last[0] - first[0])).astype(int)
        v = np.rint((ideal[:, 1] - first[1]) * (height - 1) / (last[1] - first[1])).astype(int)
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        value = np.zeros(len(ideal), dtype=np.float32)
        value[inside] = picture[v[inside], u[inside]]
        return value


def view_of(camera: Intrinsics, X_BV: Array, area: Area, height_m: float, margin_m: float = 0.0) -> ImageRegion:
    """The part of the image that shows the box above `area` (widened by `margin_m`) up to `height_m`.

    Raises ValueError when the camera does not see it.
    """
    x = (area[0] - margin_m, area[1] + margin_m)
    y = (area[2] - margin_m, area[3] + margin_m)
    corners = np.array([[a, b, c] for a in x for b in y for c in (0.0, height_m)])
    X_VB = inverse(X_BV)
    if transform(X_VB, corners)[:, 2].min() < 0.05:
        raise ValueError("the area lies beside or behind the camera")
    uv = project(camera, X_VB, corners)
    size = np.array([camera.width, camera.height])
    low = np.clip(np.floor(uv.min(axis=0)).astype(int), 0, size)
    high = np.clip(np.ceil(uv.max(axis=0)).astype(int) + 1, 0, size)
    if (high - low < 4).any():
        raise ValueError(f"the area lies outside of the image, at pixels {uv.min(axis=0)} to {uv.max(axis=0)}")
    rows, columns = slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
    return ImageRegion(camera, np.asarray(X_BV, dtype=np.float64), rows, columns)


def interpolation(pixels: slice, count: int = _NODES) -> tuple[Array, Array]:
    """Weights (n, k) that carry values at `count` = k Chebyshev nodes (k,) to the n pixels of a range."""
    middle, half = (pixels.start + pixels.stop - 1) / 2, max((pixels.stop - pixels.start) / 2, 1)
    unit = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    at_nodes = np.polynomial.chebyshev.chebvander(unit, count - 1)
    at_pixels = np.polynomial.chebyshev.chebvander((np.arange(pixels.start, pixels.stop) - middle) / half, count - 1)
    return at_pixels @ np.linalg.inv(at_nodes), middle + half * unit
