"""A depth image as undistorted points of the base frame, above a table with a known plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, CameraModel, Frame
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
        """(h, w, 3) how a point moves in the base frame with each metre of depth."""
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

    def heights(self, depth_m: Array32, part: Part = WHOLE) -> Array32:
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
