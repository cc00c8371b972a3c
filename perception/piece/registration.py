"""Corrects the camera's small error by the tool itself, which is visible and has a known kinematic pose.

A camera pose that is off by 1 mm and 0.1 degrees shifts everything by 2 to 3 px. The blade at rest shows that shift.
After the correction, the piece's place relative to the tool is off by a fraction of a millimetre.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Frame
from perception.arm_mask import ToolMask
from perception.geometry import Array32, ImageRegion

BLADE_MIDDLE_M = np.array([-0.045, 0.0, 0.0])
_REACH_M = 0.068
_SMOOTH_PX = 1.5
_CONTRAST = 40.0  # grey levels between tool and table, at least
_FARTHEST_PX = 8.0
_STEPS = 6


def tool_shift(
    frames: Sequence[Frame], poses: Sequence[Array], view: ImageRegion, tool: ToolMask, hidden: tuple[Array, float]
) -> Array | None:
    """(2,) px between the visible tool and its predicted place by its poses (4, 4), the median over `frames`.

    `hidden` is a point of the base frame and a radius around it to leave out (the object). None if the tool is not seen
    well enough, or the frames disagree.
    """
    answers = [_one(frame, X_BT, view, tool, hidden) for frame, X_BT in zip(frames, poses, strict=True)]
    shifts = [shift for shift in answers if shift is not None]
    if not shifts:
        return None
    middle: Array = np.median(shifts, axis=0)
    apart = np.abs(np.array(shifts) - middle).max()
    return middle if apart < 1.0 else None


def turn_camera(X_BC: Array, shift_px: Array, focal_px: float) -> Array:
    """`X_BC` (4, 4) rotated so that a point seen `shift_px` beside its predicted place falls onto it."""
    about_x, about_y = shift_px[1] / focal_px, -shift_px[0] / focal_px
    R, _ = cv2.Rodrigues(np.array([about_x, about_y, 0.0]))
    X = X_BC.copy()
    X[:3, :3] = X_BC[:3, :3] @ R
    return X


def _one(frame: Frame, X_BT: Array, view: ImageRegion, tool: ToolMask, hidden: tuple[Array, float]) -> Array | None:
    part = view.window(X_BT[:3, :3] @ BLADE_MIDDLE_M + X_BT[:3, 3], _REACH_M)
    if part is None:
        return None
    expected = np.isfinite(tool.depth(X_BT, part, part.directions)).reshape(part.xy.shape[:2])
    point_m, radius_m = hidden
    away = np.linalg.norm(part.xy - part.image_point(point_m[None])[0], axis=-1)
    used = away > radius_m * part.focal_px / part.depth_of(point_m)
    likeness = _likeness(frame.colour[part.rows, part.columns], expected, used)
    if likeness is None:
        return None
    return _align(_smooth(expected.astype(np.float32)), _smooth(likeness), used)


def _likeness(rgb: NDArray[np.uint8], expected: NDArray[np.bool_], used: NDArray[np.bool_]) -> Array32 | None:
    """(h, w) 1 where a pixel looks like the tool, 0 where it looks like the table; a half shadow counts as table."""
    wide = np.ones((13, 13), np.uint8)
    inside = cv2.erode(expected.astype(np.uint8), wide).astype(bool) & used
    outside = (cv2.dilate(expected.astype(np.uint8), wide) == 0) & used
    if min(inside.sum(), outside.sum()) < 30:
        return None
    tool, table = np.median(rgb[inside], axis=0), np.median(rgb[outside], axis=0)
    line = tool - table
    if np.linalg.norm(line) < _CONTRAST:
        return None
    share = (rgb - table) @ (line / (line @ line))
    return np.asarray(np.clip(2 * share - 0.5, 0, 1), dtype=np.float32)


def _smooth(picture: Array32) -> Array32:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), _SMOOTH_PX), dtype=np.float32)


def _align(expected: Array32, likeness: Array32, used: NDArray[np.bool_]) -> Array | None:
    """(2,) shift of `likeness` against `expected` (Lucas and Kanade's method)."""
    shift = np.zeros(2)
    margin = int(_FARTHEST_PX) + 1
    inner = np.zeros_like(used)
    inner[margin:-margin, margin:-margin] = used[margin:-margin, margin:-margin]
    height, width = expected.shape
    for _ in range(_STEPS):
        move = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
        moved = cv2.warpAffine(expected, move, (width, height), borderMode=cv2.BORDER_REPLICATE)
        by_v, by_u = np.gradient(moved)
        J = -np.stack([by_u[inner], by_v[inner]], axis=1).astype(np.float64)
        A = J.T @ J
        if np.linalg.eigvalsh(A)[0] < 1.0:
            return None
        shift = shift + np.linalg.solve(A, J.T @ (likeness - moved)[inner])
        if np.abs(shift).max() > _FARTHEST_PX:
            return None
    return shift
