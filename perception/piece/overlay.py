"""The picture shown to the operator: the piece found, and its wanted place."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.geometry import Area, place, project
from perception.piece.detection import PieceDetection

_AREA_RGB, _FOUND_RGB, _TARGET_RGB = (70, 130, 255), (30, 220, 60), (255, 60, 60)
_SHIFT = 4  # OpenCV draws at 1/16 px


def overlay(
    frame: Frame,
    model: CameraModel,
    X_BC: Array,
    detection: PieceDetection | None,
    area: Area,
    target_xy: Array | None = None,
) -> NDArray[np.uint8]:
    """(H, W, 3) RGB copy of the colour image with the search area, the piece found, and a cross on the target."""
    image = np.ascontiguousarray(frame.colour.copy())
    X_CB = inverse(X_BC)
    thick = max(1, frame.colour.shape[1] // 640)
    rim = [(area[i], area[j], 0.0) for i, j in ((0, 2), (1, 2), (1, 3), (0, 3))]
    _lines(image, _along(np.array([*rim, rim[0]]), model, X_CB), _AREA_RGB, thick)
    if target_xy is not None:
        x, y = np.asarray(target_xy, dtype=np.float64)
        arm = 0.008
        for ends in ([(x - arm, y, 0.0), (x + arm, y, 0.0)], [(x, y - arm, 0.0), (x, y + arm, 0.0)]):
            _lines(image, _along(np.array(ends), model, X_CB), _TARGET_RGB, thick)
    if detection is not None:
        cv2.polylines(image, [np.rint(detection.contour_px).astype(np.int32)], True, _FOUND_RGB, thick)
        u, v = np.rint(project(model.colour, X_CB, detection.centre_m)[0]).astype(int)
        label = place(detection.xy_m)
        scale = 0.45 * thick
        at = (int(u) + 14 * thick, int(v) - 8 * thick)
        cv2.putText(image, label, at, cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), thick + 2, cv2.LINE_AA)
        cv2.putText(image, label, at, cv2.FONT_HERSHEY_SIMPLEX, scale, _FOUND_RGB, thick, cv2.LINE_AA)
    return image


def _along(corners_m: Array, model: CameraModel, X_CB: Array) -> Array:
    """(N, 2) pixels of a line through `corners_m`, with points in between: real lenses bend straight lines."""
    steps = np.linspace(0, 1, 12)[:, None]
    pieces = [a + steps * (b - a) for a, b in pairwise(corners_m)]
    return project(model.colour, X_CB, np.concatenate(pieces))


def _lines(image: NDArray[np.uint8], uv: Array, rgb: tuple[int, int, int], thick: int) -> None:
    fixed = np.rint(uv * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(image, [fixed], False, rgb, thick, cv2.LINE_AA, _SHIFT)
