"""Find any target in a picture: our own board by `detection`, all others by plain OpenCV."""

from __future__ import annotations

from functools import singledispatch

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from perception.board.detection import detect, in_a_row, in_grey, is_flat, locate, read_markers, require_size
from perception.board.targets import Chessboard, Circles, Markers
from perception.board.types import Board, CalibrationTarget, Corners
from perception.errors import BoardNotFound

Image = NDArray[np.uint8] | NDArray[np.uint16]

_SCALES = (1, 2)
"""Scales to try: a marker of 20 px may be read at one of them and not at the other."""
_REACHES_PX = (2.5, 2.0)
_STEP_PX = 0.25
_LEAST_FLAT = 6
_PLANE_PX, _PLANE_SHARE = 1.0, 0.05
"""Points of a board lie within this of a plane (root mean square), or within this share of their distance."""
_CORNER_SHARE = 0.12  # of a side, left out at both ends: near a corner the next side disturbs


def find(image: Image, target: CalibrationTarget, camera: Intrinsics) -> Corners:
    """The points of `target` in a colour (H, W, 3 RGB) or grey (H, W) picture of `camera`.

    Raises BoardNotFound, WrongBoard or BoardMirrored, which name what is visible.
    """
    require_size(image, camera)
    corners = _find(target, image, camera)
    if why := _off_plane(corners, target, camera):
        raise BoardNotFound(f"no {target.name} in the picture: something looks like it, but {why}")
    return corners


@singledispatch
def _find(target: CalibrationTarget, image: Image, camera: Intrinsics) -> Corners:
    raise BoardNotFound(
        f"the program cannot find {target.name} in a picture: give corners_px and points_m with each view"
    )


@_find.register
def _board(target: Board, image: Image, camera: Intrinsics) -> Corners:
    return detect(image, target, camera)


@_find.register
def _markers(target: Markers, image: Image, camera: Intrinsics) -> Corners:
    grey = in_grey(image)
    others: set[int] = set()
    for scale in _SCALES:
        markers, strange = _read(grey, target, scale)
        others |= strange
        if markers:
            ids = np.concatenate([4 * target.ids.index(n) + np.arange(4) for n in markers])
            px = np.concatenate(list(markers.values()))
            order = np.argsort(ids)
            return Corners(ids[order], px[order])
    ids_text = ", ".join(map(str, target.ids[:6]))
    instead = f", but markers {', '.join(map(str, sorted(others)[:6]))} are" if others else ""
    raise BoardNotFound(f"marker {ids_text} of {target.dictionary} is not in the picture{instead}")


def _read(grey: NDArray[np.uint8], target: Markers, scale: int) -> tuple[dict[int, Array], set[int]]:
    """Corners (4, 2) by marker, for markers that appear exactly once, and the ids of other markers."""
    # along the edges, not at the corners: corners are often too close to the rim of the paper for a window
    ids, corners = read_markers(grey, target.dictionary, scale, cv2.aruco.CORNER_REFINE_CONTOUR)
    numbers = ids.tolist()
    markers = {
        n: along_edges(grey, px)
        for n, px in zip(numbers, corners, strict=True)
        if n in target.ids and numbers.count(n) == 1
    }
    return markers, set(numbers) - set(target.ids)


def along_edges(grey: NDArray[np.uint8], px: Array) -> Array:
    """(4, 2) rough corners of a marker, clockwise -> the intersections of lines along its four inked edges.

    OpenCV's own refinements are off by half a pixel and more where the rim of the paper is near: 2 % of the size of a
    marker of 25 px. Here each edge is fitted to the steepest rise of grey, at many places of a side.
    """
    for reach in _REACHES_PX:
        lines = [_edge(grey, px[k], px[(k + 1) % 4], px.mean(axis=0), reach) for k in range(4)]
        corners = []
        for k in range(4):
            (n0, c0), (n1, c1) = lines[k - 1], lines[k]
            corners.append(np.linalg.solve(np.stack([n0, n1]), np.array([c0, c1])))
        px = np.stack(corners)
    return px


def _edge(image: NDArray[np.uint8], start: Array, end: Array, middle: Array, reach: float) -> tuple[Array, float]:
    """The line n p = c along the ink's edge between two rough corners."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    normal = np.array([along[1], -along[0]])
    normal *= np.sign(normal @ (start - middle))
    steps = np.arange(-reach, reach + 1e-9, _STEP_PX)
    places = np.linspace(_CORNER_SHARE, 1 - _CORNER_SHARE, max(8, round(2 * length)))
    grid = (start + places[:, None] * (end - start))[:, None] + steps[:, None] * normal
    grey = cv2.remap(image, grid.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rise = np.maximum(np.diff(grey.astype(np.float64), axis=1), 0.0)  # from ink outwards it gets brighter
    rise *= rise > 0.3 * rise.max(axis=1, keepdims=True)
    weight = rise.sum(axis=1)
    at = rise @ (steps[:-1] + 0.5 * _STEP_PX) / np.maximum(weight, 1e-9)
    if (weight > 0).sum() < 4:
        return normal, float(normal @ start)
    keep = (weight > 0) & (np.abs(at - np.median(at[weight > 0])) < 1.0)
    slope, offset = np.polyfit(places[keep] * length, at[keep], 1)
    turned = normal - slope * along
    turned /= np.linalg.norm(turned)
    return turned, float(turned @ (start + offset * normal))


@_find.register
def _chessboard(target: Chessboard, image: Image, camera: Intrinsics) -> Corners:
    """Find a chessboard. OpenCV's exhaustive search comes last, because it finds small boards in other things."""
    size = (target.squares_across - 1, target.squares_down - 1)
    grey, why = in_grey(image), ""
    for search in (0, cv2.CALIB_CB_EXHAUSTIVE):
        for picture in (grey, 255 - grey):  # the second for a print with a dark rim
            flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY | search
            is_found, px = cv2.findChessboardCornersSB(picture, size, flags=flags)
            if not is_found:
                continue
            corners = Corners(np.arange(target.corners), px.reshape(-1, 2).astype(np.float64))
            why = _off_plane(corners, target, camera) or _not_chequered(grey, corners, target)
            if not why:
                return corners
    looks = f" (something looks like it, but {why})" if why else ""
    raise BoardNotFound(
        f"no {target.name} in the picture{looks}: all {size[0]} x {size[1]} inner corners must be visible, and a rim "
        "of one colour"
    )


def _off_plane(corners: Corners, target: CalibrationTarget, camera: Intrinsics) -> str:
    """Why these cannot be points of a flat board with squares of one size; "" if they can."""
    points = target.p_MK_m[corners.ids]
    if len(points) < _LEAST_FLAT or not is_flat(points) or in_a_row(points, target.spacing_m):
        return ""
    flat = cv2.undistortPoints(corners.px[:, None], camera.K, camera.distortion).reshape(-1, 2)
    flat_px = float(np.sqrt(camera.K[0, 0] * camera.K[1, 1])) * flat
    H, _ = cv2.findHomography(points[:, :2], flat_px, 0)
    if H is None:
        return "its points lie on one line"
    again = np.column_stack([points[:, :2], np.ones(len(points))]) @ H.T
    off_px = np.linalg.norm(again[:, :2] / again[:, 2:] - flat_px, axis=1)
    apart_px = np.linalg.norm(flat_px[:, None] - flat_px[None], axis=-1) + np.diag(np.full(len(points), np.inf))
    spacing_px = float(np.median(apart_px.min(axis=1)))
    rms_px, limit_px = float(np.sqrt((off_px**2).mean())), max(_PLANE_PX, _PLANE_SHARE * spacing_px)
    if rms_px > limit_px:
        return f"its points lie {rms_px:.1f} px off a plane, limit {limit_px:.1f}"
    poses = [locate(corners, target, camera)] if len(points) >= target.least else []
    if poses and poses[0].rms_px > 2.0 * limit_px:
        return f"its squares are not of one size: {poses[0].rms_px:.1f} px off, limit {2.0 * limit_px:.1f}"
    return ""


def _not_chequered(grey: NDArray[np.uint8], corners: Corners, target: Chessboard) -> str:
    """Why the squares between these corners are not dark and light in turn; "" if they are."""
    across, down = target.squares_across - 1, target.squares_down - 1
    grid = corners.px.reshape(down, across, 2)
    middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4.0
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    x, y = middles.astype(np.float32).transpose(2, 0, 1)
    levels = cv2.remap(smooth, x, y, cv2.INTER_LINEAR).astype(np.float64)
    is_one = np.add.outer(np.arange(down - 1), np.arange(across - 1)) % 2 == 0
    one, other = levels[is_one], levels[~is_one]
    if min(one.min() - other.max(), np.inf) > 0.0 or other.min() - one.max() > 0.0:
        return ""
    step = abs(float(np.median(one) - np.median(other)))
    stray = max(float(np.ptp(one)), float(np.ptp(other)))
    return "" if step > stray else "its squares are not dark and light in turn"


@_find.register
def _circles(target: Circles, image: Image, camera: Intrinsics) -> Corners:
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if target.staggered else cv2.CALIB_CB_SYMMETRIC_GRID
    grey, size = in_grey(image), (target.across, target.down)
    is_found, px = cv2.findCirclesGrid(grey, size, flags=kind | cv2.CALIB_CB_CLUSTERING)
    if not is_found:
        is_found, px = cv2.findCirclesGrid(grey, size, flags=kind)
    if not is_found:
        raise BoardNotFound(f"no grid of {target.name} in the picture: all of them must be visible, dark on white")
    return Corners(np.arange(target.corners), px.reshape(-1, 2).astype(np.float64))
