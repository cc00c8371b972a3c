"""The coverage of the views so far, and the missing parts of the image, tilts and distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.poses import centre, tilt_and_turn
from hw.types import Array, Intrinsics
from perception.board.types import Board, Corners

COLUMNS, ROWS = 4, 3
LEAN_DEG = 12.0
"""The smallest tilt that counts; under 8° the closed forms are 3 to 5 times worse."""
DISTANCE_RATIO = 1.35

_SIDES = (
    "its top towards the camera",
    "its top away from the camera",
    "its left side away from the camera",
    "its right side away from the camera",
)
"""In this order: about the image's X axis positive, negative; about its Y axis positive, negative."""

_CELLS_WANTED = 8


@dataclass(frozen=True, eq=False)
class Coverage:
    """The coverage of all views together."""

    cells: NDArray[np.int64]  # (ROWS, COLUMNS) corners seen in each part of the image
    tilts_deg: Array  # (N, 2) of every view, about the image's X and Y axis
    distances_m: Array  # (N,)
    missing: tuple[str, ...]  # advice for the next views, the most useful first

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return not self.missing


def coverage(corners: Sequence[Corners], X_CM: Sequence[Array], board: Board, camera: Intrinsics) -> Coverage:
    """The coverage of views with these corners and board poses (4, 4)."""
    cells = np.zeros((ROWS, COLUMNS), dtype=np.int64)
    for seen in corners:
        column = np.clip(seen.px[:, 0] / camera.width * COLUMNS, 0, COLUMNS - 1).astype(int)
        row = np.clip(seen.px[:, 1] / camera.height * ROWS, 0, ROWS - 1).astype(int)
        np.add.at(cells, (row, column), 1)
    tilts = np.rad2deg(np.array([tilt_and_turn(X, board)[:2] for X in X_CM]).reshape(-1, 2))
    distances = np.array([np.linalg.norm(centre(X, board)) for X in X_CM])
    return Coverage(cells, tilts, distances, (*_tilts(tilts), *_distances(distances), *_cells(cells)))


def _tilts(tilts_deg: Array) -> list[str]:
    x, y = tilts_deg.T
    done = [(x > LEAN_DEG).any(), (x < -LEAN_DEG).any(), (y > LEAN_DEG).any(), (y < -LEAN_DEG).any()]
    return [f"tilt the board, {side}, by 20 to 40°" for side, ok in zip(_SIDES, done, strict=True) if not ok]


def _distances(distances_m: Array) -> list[str]:
    if len(distances_m) < 2:
        return ["hold the board nearer to the camera, and farther away"]
    if distances_m.max() / distances_m.min() >= DISTANCE_RATIO:
        return []
    return [f"all views are {distances_m.mean():.2f} m away: hold the board nearer to the camera, or farther"]


def _cells(cells: NDArray[np.int64]) -> list[str]:
    if np.count_nonzero(cells) >= _CELLS_WANTED:
        return []
    rows, columns = ("top", "middle", "bottom"), ("left", "left of the middle", "right of the middle", "right")
    empty = [f"{rows[r]} {columns[c]}" for r, c in np.argwhere(cells == 0)]
    return [f"show the board in more of the image: it has not been at {', '.join(empty[:3])}"]
