"""Pictures of a board without ray casting: the print, warped into the image of a camera without lens distortion."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from perception.board import draw
from perception.board.types import Board

CAMERA = Intrinsics(640, 360, np.array([[413.0, 0, 319.0], [0, 413.0, 181.0], [0, 0, 1]]))
_SQUARE_PX = 42
_FINE = 2


@lru_cache
def _print(across: int, down: int, dictionary: str) -> NDArray[np.uint8]:
    return draw(Board(across, down, dictionary=dictionary), _SQUARE_PX, margin_px=_SQUARE_PX // 3)


def picture(X_CM: Array, board: Board, camera: Intrinsics = CAMERA, seed: int = 0) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of the board at X_CM (4, 4) before a grey wall, with a little blur and noise."""
    ink = _print(board.squares_across, board.squares_down, board.dictionary)
    margin = _SQUARE_PX // 3
    per_px = board.square_m / _SQUARE_PX
    to_board = np.array([[per_px, 0, -(margin - 0.5) * per_px], [0, per_px, -(margin - 0.5) * per_px], [0, 0, 1]])
    fine = np.array([[_FINE, 0, (_FINE - 1) / 2], [0, _FINE, (_FINE - 1) / 2], [0, 0, 1]])
    H = fine @ camera.K @ X_CM[:3, [0, 1, 3]] @ to_board
    size = (_FINE * camera.width, _FINE * camera.height)
    grey = cv2.warpPerspective(
        (30 + 0.8 * ink).astype(np.uint8),
        H,
        size,
        flags=cv2.INTER_AREA,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=110,
    )
    small = cv2.resize(grey, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0, 1.0, small.shape)
    rgb = np.clip(cv2.GaussianBlur(small, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(np.repeat(rgb[..., None], 3, axis=2))
