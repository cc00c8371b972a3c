"""The picture shown to the operator before a push: the mark, the goal, and the bottle that was found."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.bottle.detection import BottleDetection
from perception.cylinder import Cylinder
from perception.geometry import place, project

_MARK_RGB, _FOUND_RGB, _GOAL_RGB = (70, 130, 255), (30, 220, 60), (255, 60, 60)
_SHIFT = 4  # OpenCV draws at 1/16 px
_FILL = 0.35
_NEAR_M = 0.05
_TURN = np.linspace(0, 2 * np.pi, 73)

Image = NDArray[np.uint8]


def overlay(
    frame: Frame,
    model: CameraModel,
    X_BC: Array,
    detection: BottleDetection | None,
    body: Cylinder,
    mark_m: Array,
    goal_m: Array,
) -> Image:
    """(H, W, 3) RGB copy of the colour image with everything drawn in perspective on the table.

    The goal is a disc of the bottle's size with a ring of 5 cm. The mark `mark_m` (2,) is a circle of the bottle's
    size. The bottle is drawn as an outline.
    """
    image = np.ascontiguousarray(frame.colour.copy())
    thick = max(1, image.shape[1] // 640)

    def seen(points_m: Array) -> Array:
        return project(model.colour, inverse(X_BC), points_m)

    disc = _fixed(seen(_ring(goal_m, body.radius_m)))
    filled = image.copy()
    cv2.fillPoly(filled, [disc], _GOAL_RGB, cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(filled, _FILL, image, 1 - _FILL, 0, dst=image)
    _line(image, disc, _GOAL_RGB, thick)
    _line(image, _fixed(seen(_ring(goal_m, _NEAR_M))), _GOAL_RGB, thick)
    _line(image, _fixed(seen(_ring(mark_m, body.radius_m))), _MARK_RGB, thick)
    _label(image, seen(_at(goal_m, 0.0))[0], f"goal: {place(goal_m)}", _GOAL_RGB, thick)
    if detection is not None:
        outline = cv2.convexHull(seen(_rims(detection)).astype(np.float32)).reshape(-1, 2)
        _line(image, _fixed(np.concatenate([outline, outline[:1]])), _FOUND_RGB, thick)
        corner = np.array([outline[:, 0].max(), outline[:, 1].min()])
        _label(image, corner, f"bottle: {place(detection.xy_m)}", _FOUND_RGB, thick, beside_px=6)
    return image


def _rims(detection: BottleDetection) -> Array:
    X = detection.X_BO
    rims: Array = detection.body.rims_m @ X[:3, :3].T + X[:3, 3]
    return rims


def _ring(xy_m: Array, radius_m: float) -> Array:
    return np.column_stack([xy_m[0] + radius_m * np.cos(_TURN), xy_m[1] + radius_m * np.sin(_TURN), 0 * _TURN])


def _at(xy_m: Array, z_m: float) -> Array:
    return np.array([[xy_m[0], xy_m[1], z_m]])


def _fixed(uv: Array) -> NDArray[np.int32]:
    return np.rint(uv * (1 << _SHIFT)).astype(np.int32)


def _line(image: Image, fixed: NDArray[np.int32], rgb: tuple[int, int, int], thick: int) -> None:
    cv2.polylines(image, [fixed], False, rgb, thick, cv2.LINE_AA, _SHIFT)


def _label(
    image: Image, uv: Array, text: str, rgb: tuple[int, int, int], thick: int, beside_px: float | None = None
) -> None:
    """Text beside a point, bright on dark to be readable on any background, kept inside the image."""
    scale = 0.45 * thick
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)
    right = int(uv[0] + (32 * thick if beside_px is None else beside_px))
    at = (int(np.clip(right, 0, image.shape[1] - width)), int(np.clip(uv[1], height, image.shape[0] - 4)))
    for colour, width_px in (((0, 0, 0), thick + 2), (rgb, thick)):
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, width_px, cv2.LINE_AA)
