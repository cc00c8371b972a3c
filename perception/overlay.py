"""The pictures shown to the operator before a trial: the object that was found, and its wanted place."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.bottle.detection import BottleDetection
from perception.cylinder import Cylinder
from perception.geometry import Area, position_in_words, project
from perception.piece.detection import PieceDetection

_PLACE_RGB, _FOUND_RGB, _TARGET_RGB = (70, 130, 255), (30, 220, 60), (255, 60, 60)
_SHIFT = 4  # OpenCV draws at 1/16 px
_FILL = 0.35
_NEAR_M = 0.05
_TURN = np.linspace(0, 2 * np.pi, 73)

Image = NDArray[np.uint8]
Rgb = tuple[int, int, int]


def overlay_piece(
    frame: Frame,
    model: CameraModel,
    X_BC: Array,
    detection: PieceDetection | None,
    area: Area,
    target_xy: Array | None = None,
) -> Image:
    """(H, W, 3) RGB copy of the colour image with the search area, the piece found, and a cross on the target."""
    image = np.ascontiguousarray(frame.colour.copy())
    X_CB = inverse(X_BC)
    thick = max(1, image.shape[1] // 640)

    def line(corners_m: Array, rgb: Rgb) -> None:
        """A line through `corners_m` (N, 3), with points in between: real lenses bend straight lines."""
        steps = np.linspace(0, 1, 12)[:, None]
        points_m = np.concatenate([a + steps * (b - a) for a, b in pairwise(corners_m)])
        _line(image, _fixed(project(model.colour, X_CB, points_m)), rgb, thick)

    rim = [(area[i], area[j], 0.0) for i, j in ((0, 2), (1, 2), (1, 3), (0, 3))]
    line(np.array([*rim, rim[0]]), _PLACE_RGB)
    if target_xy is not None:
        x, y = np.asarray(target_xy, dtype=np.float64)
        arm = 0.008
        for ends in ([(x - arm, y, 0.0), (x + arm, y, 0.0)], [(x, y - arm, 0.0), (x, y + arm, 0.0)]):
            line(np.array(ends), _TARGET_RGB)
    if detection is not None:
        cv2.polylines(image, [np.rint(detection.contour_px).astype(np.int32)], True, _FOUND_RGB, thick)
        u, v = np.rint(project(model.colour, X_CB, detection.centre_m)[0]).astype(int)
        words = f"near side: {position_in_words(detection.near_m)}"  # the place that the task policy gets
        _text(image, (int(u) + 14 * thick, int(v) - 8 * thick), words, _FOUND_RGB, thick)
    return image


def overlay_bottle(
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

    def pixels_of(points_m: Array) -> Array:
        return project(model.colour, inverse(X_BC), points_m)

    disc = _fixed(pixels_of(_ring(goal_m, body.radius_m)))
    filled = image.copy()
    cv2.fillPoly(filled, [disc], _TARGET_RGB, cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(filled, _FILL, image, 1 - _FILL, 0, dst=image)
    _line(image, disc, _TARGET_RGB, thick)
    _line(image, _fixed(pixels_of(_ring(goal_m, _NEAR_M))), _TARGET_RGB, thick)
    _line(image, _fixed(pixels_of(_ring(mark_m, body.radius_m))), _PLACE_RGB, thick)
    u, v = pixels_of(np.array([[*goal_m, 0.0]]))[0]
    _label(image, u + 32 * thick, v, f"goal: {position_in_words(goal_m)}", _TARGET_RGB, thick)
    if detection is not None:
        X_BO = detection.X_BO
        rims_px = pixels_of(detection.body.rims_m @ X_BO[:3, :3].T + X_BO[:3, 3])
        outline = cv2.convexHull(rims_px.astype(np.float32)).reshape(-1, 2)
        _line(image, _fixed(np.concatenate([outline, outline[:1]])), _FOUND_RGB, thick)
        _label(
            image,
            outline[:, 0].max() + 6,
            outline[:, 1].min(),
            f"bottle: {position_in_words(detection.xy_m)}",
            _FOUND_RGB,
            thick,
        )
    return image


def _ring(xy_m: Array, radius_m: float) -> Array:
    return np.column_stack([xy_m[0] + radius_m * np.cos(_TURN), xy_m[1] + radius_m * np.sin(_TURN), 0 * _TURN])


def _fixed(uv: Array) -> NDArray[np.int32]:
    return np.rint(uv * (1 << _SHIFT)).astype(np.int32)


def _line(image: Image, fixed: NDArray[np.int32], rgb: Rgb, thick: int) -> None:
    cv2.polylines(image, [fixed], False, rgb, thick, cv2.LINE_AA, _SHIFT)


def _label(image: Image, u: float, v: float, text: str, rgb: Rgb, thick: int) -> None:
    """Text at a point, kept inside the image."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * thick, thick)
    at = int(np.clip(int(u), 0, image.shape[1] - width)), int(np.clip(v, height, image.shape[0] - 4))
    _text(image, at, text, rgb, thick)


def _text(image: Image, at: tuple[int, int], text: str, rgb: Rgb, thick: int) -> None:
    """Bright on dark, to be readable on any background."""
    for colour, width_px in (((0, 0, 0), thick + 2), (rgb, thick)):
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * thick, colour, width_px, cv2.LINE_AA)
