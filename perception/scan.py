"""A depth image as undistorted points of the base frame, above a table that refines the calibration.

A small error of the camera pose tilts and lifts the table; a systematic depth error does so in another pattern. Both
are estimated at once (`refine`), each with a prior of its expected size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, CameraModel, Frame
from perception.errors import TableNotFound
from perception.geometry import Area, Array32, ImageRegion, view_of

Mask = NDArray[np.bool_]
Raw = NDArray[np.uint16]
Part = tuple[slice, slice]
"""Rows and columns of a scan."""
WHOLE: Part = np.s_[:, :]


@dataclass(frozen=True)
class DepthError:
    """The systematic error of a depth camera: an offset in m, and a share of the distance."""

    bias_m: float = 0.0
    gain: float = 0.0


@dataclass(frozen=True, eq=False)
class Scan:
    """A part of the depth image, ready to become points. Everything is (h, w) like that part."""

    view: ImageRegion
    error: DepthError = DepthError()

    @cached_property
    def along(self) -> Array32:
        """(h, w, 3) motion of a point in the base frame for each metre of depth."""
        h, w = self.view.xy.shape[:2]
        turned = self.view.directions @ self.view.X_BV[:3, :3].T.astype(np.float32)
        return np.ascontiguousarray(turned.reshape(h, w, 3))

    @cached_property
    def along_z(self) -> Array32:
        """(h, w) vertical components of the rays."""
        return np.ascontiguousarray(self.along[..., 2])

    @cached_property
    def table_m(self) -> Array32:
        """Depth of the plane z = 0; inf where a ray does not meet it."""
        with np.errstate(divide="ignore"):
            depth = -np.float32(self.view.X_BV[2, 3]) / self.along_z
        return np.where(depth > 0, depth, np.float32(np.inf))

    def raw(self, frame: Frame) -> Raw:
        """(h, w) raw readings in mm; a view, not a copy."""
        return frame.depth_mm[self.view.rows, self.view.columns]

    def depth(self, raw: Raw) -> Array32:
        """Readings in m, corrected for the camera's known error; 0 where there is none."""
        depth = raw.astype(np.float32)
        depth *= np.float32(1e-3 / (1 + self.error.gain))
        depth -= np.float32(self.error.bias_m / (1 + self.error.gain))
        depth *= raw > 0
        return depth

    def heights(self, depth_m: Array32, part: Part) -> Array32:
        """Heights (m) above the table of readings in `part` of the scan; without a reading, the camera's height."""
        height: Array32 = depth_m * self.along_z[part] + np.float32(self.view.X_BV[2, 3])
        return height

    def points(self, depth_m: Array32, chosen: Mask, part: Part = WHOLE) -> Array:
        """(n, 3) points in the base frame of the `chosen` pixels of `part`, row by row; `depth_m` has the shape of
        `part`.
        """
        moved = depth_m[chosen][:, None] * self.along[part][chosen]
        return np.asarray(moved, dtype=np.float64) + self.view.X_BV[:3, 3]

    def rectangle(self, part: ImageRegion) -> Part:
        """Where `part` (a window of this view) lies in the arrays of this scan."""
        top, left = self.view.rows.start, self.view.columns.start
        return (
            slice(part.rows.start - top, part.rows.stop - top),
            slice(part.columns.start - left, part.columns.stop - left),
        )


def scan_of(model: CameraModel, X_BC: Array, area: Area, height_m: float, error: DepthError = DepthError()) -> Scan:
    """The part of the depth image that shows `area` up to `height_m`. Raises ValueError if it is not in view."""
    return Scan(view_of(model.depth, X_BC @ model.X_CD, area, height_m), error)


_CELL_PX = 24
_CELL_MIN_READINGS = 60
_CELL_STD_M = 0.0010  # the camera's slow ripple, in the median of a cell
_FEWEST_CELLS = 12
_NEAR_M = 0.03  # readings farther from the expected plane are not table
_BIAS_STD_M, _GAIN_STD = 0.0020, 0.0006  # of the depth camera
_SHIFT_STD_M, _TURN_STD_RAD = 0.0012, float(np.deg2rad(0.12))  # of the calibration, along each axis


@dataclass(frozen=True, eq=False)
class TableFit:
    """The camera, refined by the table."""

    X_BV: Array  # (4, 4) refined pose of the depth camera in the base frame
    error: DepthError
    rms_m: float  # residual over the cells
    off_m: float  # largest distance of the table from z = 0 before, along the rays
    turned_rad: float  # rotation of the pose by the fit


def refine(scan: Scan, depth_m: Array32) -> TableFit:
    """The most probable camera pose and depth error that put the table's readings (h, w) onto z = 0.

    The rotation about the vertical and shifts along the table are
    not observable and stay. Raises TableNotFound if too little of the table is seen near z = 0.
    """
    off_m, rows, columns = _cells(scan, depth_m)
    ray = scan.view.directions.reshape(*scan.table_m.shape, 3)[rows, columns].astype(np.float64)
    expected = scan.table_m[rows, columns].astype(np.float64)
    up = scan.view.X_BV[2, :3]  # the vertical in the camera's frame
    falling = ray @ up
    by_turn = -(expected / falling)[:, None] * np.cross(ray, up)
    J = np.column_stack([np.ones(len(off_m)), expected, -1 / falling, by_turn])
    prior = np.array([_BIAS_STD_M, _GAIN_STD, _SHIFT_STD_M, *(3 * [_TURN_STD_RAD])])
    weight, x = np.ones(len(off_m)), np.zeros(6)
    for _ in range(4):
        A = (J * weight[:, None]).T @ J / _CELL_STD_M**2 + np.diag(prior**-2)
        x = np.linalg.solve(A, (J * weight[:, None]).T @ off_m / _CELL_STD_M**2)
        weight = 1 / (1 + ((off_m - J @ x) / (2 * _CELL_STD_M)) ** 2)
    R, _ = cv2.Rodrigues(x[3:])
    X_BV = scan.view.X_BV.copy()
    X_BV[:3, :3] = X_BV[:3, :3] @ R
    X_BV[2, 3] += x[2]
    left = off_m - J @ x
    error = DepthError(scan.error.bias_m + float(x[0]), scan.error.gain + float(x[1]))
    rms_m = float(np.sqrt(np.average(left**2, weights=weight)))
    return TableFit(X_BV, error, rms_m, float(np.abs(J @ x).max()), float(np.linalg.norm(x[3:])))


def _cells(scan: Scan, depth_m: Array32) -> tuple[Array, Array, Array]:
    """Median of measured minus expected depth on the table in cells of the image: (n,), and the cells' middle rows and
    columns.
    """
    off = depth_m - scan.table_m
    use = (depth_m > 0) & (np.abs(off) < _NEAR_M)
    h, w = (size // _CELL_PX for size in off.shape)
    cut = np.s_[: h * _CELL_PX, : w * _CELL_PX]
    blocks = [a[cut].reshape(h, _CELL_PX, w, _CELL_PX).swapaxes(1, 2).reshape(h * w, -1) for a in (off, use)]
    counts = blocks[1].sum(axis=1)
    full = counts >= _CELL_MIN_READINGS
    if full.sum() < _FEWEST_CELLS:
        raise TableNotFound(
            f"only {full.sum()} of {h * w} parts of the picture show the table within {1e3 * _NEAR_M:.0f} mm of "
            f"where the calibration puts it, but {_FEWEST_CELLS} are needed; clear the table, or "
            "calibrate the camera again"
        )
    chosen = np.where(blocks[1][full], blocks[0][full], np.nan)
    rows, columns = (np.flatnonzero(full) // w, np.flatnonzero(full) % w)
    middle = _CELL_PX // 2
    return np.nanmedian(chosen, axis=1).astype(np.float64), rows * _CELL_PX + middle, columns * _CELL_PX + middle
