"""The picture for the operator: corners found, the board's axes, and the coverage of earlier views."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from perception.board.types import CalibrationTarget, Corners

_HEIGHT_PX = 720
_QUALITY = 85


def draw(
    colour: NDArray[np.uint8],
    corners: Corners,
    X_CM: Array,
    before: Sequence[Corners],
    board: CalibrationTarget,
    camera: Intrinsics,
) -> bytes:
    """JPEG of the picture (H, W, 3 RGB): corners in the order of their ids from blue to red, earlier ones faint."""
    scale = max(1, round(camera.height / _HEIGHT_PX))
    image = np.ascontiguousarray(colour[..., ::-1])
    faint = image.copy()
    for seen in before:
        for u, v in seen.px:
            cv2.circle(faint, (round(u), round(v)), 2 * scale, (200, 160, 60), -1, cv2.LINE_AA)
    image = cv2.addWeighted(faint, 0.45, image, 0.55, 0)
    for number, (u, v) in zip(corners.ids, corners.px, strict=True):
        share = number / max(board.corners - 1, 1)
        hue = np.array([[[round(120 * (1 - share)), 255, 255]]], dtype=np.uint8)
        bgr = tuple(int(c) for c in cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0])
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * 4 * scale, bgr, scale, cv2.LINE_AA, shift=4)
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * scale // 2, bgr, -1, cv2.LINE_AA, shift=4)
    axes = np.vstack([np.zeros(3), 2 * board.spacing_m * np.eye(3)]) @ X_CM[:3, :3].T + X_CM[:3, 3]
    px = cv2.projectPoints(axes, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0].reshape(-1, 2)
    for end, bgr in zip(px[1:], ((40, 40, 230), (60, 180, 40), (230, 90, 30)), strict=True):
        cv2.arrowedLine(image, _whole(px[0]), _whole(end), bgr, 2 * scale, cv2.LINE_AA, tipLength=0.2)
    done, data = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
    return data.tobytes() if done else b""


def _whole(px: Array) -> tuple[int, int]:
    return round(float(px[0])), round(float(px[1]))
