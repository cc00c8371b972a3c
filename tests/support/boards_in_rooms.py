"""Plain chessboards drawn into photographs of a real room, where other things look like small boards."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import real_views
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from perception.board.targets import Chessboard

PX = 40  # of a square on the drawing


@dataclass(frozen=True, eq=False)
class BoardInRoom:
    """A picture, and the true pixels (K, 2) of the board's inner corners in the order of the drawing."""

    picture: NDArray[np.uint8]
    px: Array
    camera: Intrinsics


def photograph(number: int) -> NDArray[np.uint8]:
    """(480, 640, 3) RGB of camera 2."""
    picture = cv2.imread(str(real_views.DATA / f"camera-2-{number:02d}.jpg"))
    assert picture is not None
    return np.ascontiguousarray(picture[..., ::-1], dtype=np.uint8)


def drawing(board: Chessboard, *, is_inverted: bool) -> tuple[NDArray[np.uint8], Array]:
    """The print in grey with a rim of one square, and its inner corners (K, 2) on it, row by row."""
    across, down = board.squares_across, board.squares_down
    squares = np.add.outer(np.arange(down), np.arange(across)) % 2 * 205 + 25
    grey = np.pad(np.kron(squares, np.ones((PX, PX))), PX, constant_values=230).astype(np.uint8)
    u, v = np.meshgrid(np.arange(1, across), np.arange(1, down))
    corners = np.asarray(PX * (np.stack([u, v], axis=-1).reshape(-1, 2) + 1.0) - 0.5, dtype=np.float64)
    return (255 - grey if is_inverted else grey), corners


def board_in_room(board: Chessboard, number: int, *, is_inverted: bool, width_px: float = 110.0) -> BoardInRoom:
    """A board held into photograph `number`, tilted by up to 40°, with its noise."""
    rng, camera, picture = np.random.default_rng((number, is_inverted)), real_views.camera(2), photograph(number)
    grey, corners = drawing(board, is_inverted=is_inverted)
    size_m = board.spacing_m / PX
    distance_m = camera.K[0, 0] * board.squares_across * board.spacing_m / width_px
    R = cv2.Rodrigues(np.deg2rad(rng.uniform(-40, 40, 3)))[0]
    middle = np.array([*rng.uniform([-0.28, -0.2], [0.28, 0.2]) * distance_m, distance_m])

    def seen(places: Array) -> Array:
        flat = np.column_stack([(places - np.array(grey.shape[::-1]) / 2) * size_m, np.zeros(len(places))])
        return np.asarray(
            cv2.projectPoints(flat @ R.T + middle, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0][:, 0]
        )

    h, w = grey.shape
    outline = np.array([[0, 0], [w, 0], [w, h], [0, h]], dtype=np.float64) - 0.5
    H, _ = cv2.findHomography(outline, seen(outline))
    shape = (picture.shape[1], picture.shape[0])
    print_seen = cv2.warpPerspective(grey, H, shape, flags=cv2.INTER_AREA).astype(np.float64)
    share = cv2.warpPerspective(np.full_like(grey, 255), H, shape, flags=cv2.INTER_AREA)[..., None] / 255.0
    mixed = picture * (1.0 - share) + cv2.GaussianBlur(print_seen, (0, 0), 0.7)[..., None] * share
    noisy = mixed + rng.normal(0.0, 2.0, mixed.shape)
    return BoardInRoom(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), seen(corners), camera)


def distance_px(px: Array, truth: BoardInRoom) -> float:
    """The largest distance of a corner in px (K, 2) to the nearest true one."""
    apart = np.linalg.norm(px[:, None] - truth.px[None], axis=-1)
    return float(apart.min(axis=1).max())
