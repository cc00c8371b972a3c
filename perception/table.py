"""The table as the depth camera sees it: found without any calibration, or used to refine one.

A camera pose that is a little off tilts and lifts the table; a depth camera that reads too much does so too, in
another pattern. Both are estimated at once, each with the size it is expected to have.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from hw.types import Array
from perception.errors import TableNotFound
from perception.geometry import Array32
from perception.scan import DepthError, Mask, Scan

_CELL_PX = 24
_CELL_MIN_READINGS = 60
_CELL_STD_M = 0.0010  # what a camera's slow ripple leaves in the median of a cell
_FEWEST_CELLS = 12
_NEAR_M = 0.03  # farther off the expected plane is not table
_BIAS_STD_M, _GAIN_STD = 0.0020, 0.0006  # of the depth camera
_SHIFT_STD_M, _TURN_STD_RAD = 0.0012, float(np.deg2rad(0.12))  # of the calibration, along each axis
_TRIES, _SAMPLE = 400, 4000


@dataclass(frozen=True, eq=False)
class TableFit:
    """What the table says of the camera."""

    X_BV: Array  # (4, 4) refined pose of the depth camera in the base frame
    error: DepthError
    rms_m: float  # what is left, over the cells
    off_m: float  # how far along the rays the table appeared from z = 0 before, at most
    turned_rad: float  # by how much the pose was turned


def refine(scan: Scan, depth_m: Array32, clear: Mask | None = None) -> TableFit:
    """Camera pose and depth error that put the readings (h, w) on the table onto z = 0, most probably.

    `clear` (h, w) leaves out what is known not to be table. Turn about the vertical and shifts along the table
    cannot be seen and stay. Raises TableNotFound where too little of the table is seen near z = 0.
    """
    off_m, rows, columns = _cells(scan, depth_m, clear)
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


def _cells(scan: Scan, depth_m: Array32, clear: Mask | None) -> tuple[Array, Array, Array]:
    """Median of measured minus expected depth on the table in cells of the image: (n,), their middles' row, column."""
    off = depth_m - scan.table_m
    use = (depth_m > 0) & (np.abs(off) < _NEAR_M)
    if clear is not None:
        use &= clear
    h, w = (size // _CELL_PX for size in off.shape)
    cut = np.s_[: h * _CELL_PX, : w * _CELL_PX]
    blocks = [a[cut].reshape(h, _CELL_PX, w, _CELL_PX).swapaxes(1, 2).reshape(h * w, -1) for a in (off, use)]
    counts = blocks[1].sum(axis=1)
    full = counts >= _CELL_MIN_READINGS
    if full.sum() < _FEWEST_CELLS:
        raise TableNotFound(
            f"only {full.sum()} of {h * w} parts of the picture show the table within {1e3 * _NEAR_M:.0f} mm of "
            f"where the calibration puts it, {_FEWEST_CELLS} are needed; clear the table, or calibrate the camera again"
        )
    chosen = np.where(blocks[1][full], blocks[0][full], np.nan)
    rows, columns = (np.flatnonzero(full) // w, np.flatnonzero(full) % w)
    middle = _CELL_PX // 2
    return np.nanmedian(chosen, axis=1).astype(np.float64), rows * _CELL_PX + middle, columns * _CELL_PX + middle


@dataclass(frozen=True, eq=False)
class Plane:
    """Points with normal . p = offset_m."""

    normal: Array  # (3,) unit
    offset_m: float
    share: float  # of the points asked that lie on it
    rms_m: float  # of these


def find_plane(
    points_m: Array, up: Array, rng: np.random.Generator, within_rad: float = 0.45, near_m: float = 0.006
) -> Plane:
    """The plane that most of `points_m` (N, 3) lie on, of those with a normal within `within_rad` of `up` (3,).

    Random triples (Fischler and Bolles, 1981), then least squares over what lies within `near_m`.
    Raises TableNotFound when no such plane holds a fiftieth of the points.
    """
    few = points_m[rng.choice(len(points_m), min(_SAMPLE, len(points_m)), replace=False)]
    corners = few[rng.integers(0, len(few), (_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(length, 1e-12)[:, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    good = (length > 1e-5) & (normals @ up > np.cos(within_rad))
    offsets = np.einsum("ti,ti->t", normals, corners[:, 0])
    count = np.where(good, (np.abs(few @ normals.T - offsets) < near_m).sum(axis=0), 0)
    best = int(count.argmax())
    if count[best] < len(few) / 50:
        raise TableNotFound(
            f"no plane that faces up holds a fiftieth of the {len(points_m)} points; point the camera at the table"
        )
    normal, offset_m = normals[best], float(offsets[best])
    for _ in range(8):
        on = points_m[np.abs(points_m @ normal - offset_m) < near_m]
        middle = on.mean(axis=0)
        _, _, axes = np.linalg.svd(np.linalg.qr(on - middle, mode="r"))
        normal = axes[2] * np.sign(axes[2] @ up)
        offset_m = float(normal @ middle)
    left = points_m @ normal - offset_m
    near = np.abs(left) < near_m
    return Plane(normal, offset_m, float(near.mean()), float(np.sqrt(np.mean(left[near] ** 2))))


def table_frame(plane: Plane) -> Array:
    """(4, 4) pose X_BV of a camera, given the table in its frame: Z up from the table, X where it looks, Y left.

    The origin lies on the table below the camera.
    """
    z = plane.normal
    x = np.array([0.0, 0.0, 1.0]) - z[2] * z
    x /= np.linalg.norm(x)
    R_BV = np.stack([x, np.cross(z, x), z])
    X = np.eye(4)
    X[:3, :3], X[2, 3] = R_BV, -plane.offset_m
    return X
