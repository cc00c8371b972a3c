"""Plans the board's poses before the camera that together determine the calibration.

Spread matters more than number (`benchmarks/calibration.py`): the board tilted to all sides by 20° to 40°, near and
far, in every reachable part of the image, and rotated about the line of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from hw.types import Array, Intrinsics
from perception.board.types import Board, Corners

TILT_DEG = (18.0, 42.0)
TURN_DEG = 40.0
RIM_PX = 12.0
"""The whole print stays at least this share inside the image, because the camera pose is only roughly known."""

_UNITS = np.array([0.28, 0.28, 0.30, 0.45, 0.45, 0.9])
"""Scales of equal difference: image width and height, relative distance, tilts and rotation in rad."""


def candidates(camera: Intrinsics, board: Board, count: int, distance_m: tuple[float, float], seed: int = 0) -> Array:
    """Board poses X_CM (N, 4, 4), N <= `count`, all wholly inside the image. Evenly spread and deterministic."""
    draws = qmc.Sobol(6, seed=seed).random(count)
    pixels = draws[:, :2] * [camera.width - 1, camera.height - 1]
    flat = cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion).reshape(-1, 2)
    away_m = np.exp(np.log(distance_m[0]) + draws[:, 2] * np.log(distance_m[1] / distance_m[0]))
    tilt = np.deg2rad(TILT_DEG[0] + draws[:, 3] * (TILT_DEG[1] - TILT_DEG[0]))
    towards = 2 * np.pi * draws[:, 4]
    turn = np.deg2rad(TURN_DEG * (2 * draws[:, 5] - 1))
    poses = np.array([_pose(*p, board) for p in zip(flat, away_m, tilt, towards, turn, strict=True)])
    return poses[[_inside(X, board, camera) for X in poses]]


def spread(X_CM: Array, board: Board, count: int) -> Array:
    """Indices of up to `count` of the poses (N, 4, 4), chosen so that each is the farthest from those before it."""
    features = np.array([_features(X, board) for X in X_CM]) / _UNITS
    if not len(features):
        return np.zeros(0, dtype=int)
    chosen = [int(np.linalg.norm(features - np.median(features, axis=0), axis=1).argmax())]
    nearest = np.full(len(features), np.inf)
    while len(chosen) < min(count, len(features)):
        nearest = np.minimum(nearest, np.linalg.norm(features - features[chosen[-1]], axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(chosen)


def tilt_and_turn(X_CM: Array, board: Board) -> tuple[float, float, float]:
    """The board's orientation to the line of sight through its centre: tilts about the image's X and Y, and rotation,
    rad.
    """
    square = _facing(centre(X_CM, board))
    normal = square.T @ X_CM[:3, 2]
    across = square.T @ X_CM[:3, 0]
    tilts = -np.arcsin(np.clip(normal[1], -1, 1)), np.arcsin(np.clip(normal[0], -1, 1))
    return float(tilts[0]), float(tilts[1]), float(np.arctan2(across[1], across[0]))


def centre(X_CM: Array, board: Board) -> Array:
    """(3,) centre of the print in the camera frame."""
    middle = np.array([*np.array(board.size_m) / 2, 0.0])
    return np.asarray(X_CM[:3, :3] @ middle + X_CM[:3, 3])


def _pose(flat: Array, away_m: float, tilt: float, towards: float, turn: float, board: Board) -> Array:
    ray = np.array([*flat, 1.0])
    ray *= away_m / np.linalg.norm(ray)
    leaning = Rotation.from_rotvec(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))
    X = np.eye(4)
    X[:3, :3] = _facing(ray) @ (leaning * Rotation.from_euler("z", turn)).as_matrix()
    X[:3, 3] = ray - X[:3, :3] @ np.array([*np.array(board.size_m) / 2, 0.0])
    return X


def _facing(p_C_m: Array) -> Array:
    """(3, 3) axes with Z along the line of sight to a point, upright in the image."""
    z = p_C_m / np.linalg.norm(p_C_m)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _inside(X_CM: Array, board: Board, camera: Intrinsics) -> bool:
    rim = board.outline_m @ X_CM[:3, :3].T + X_CM[:3, 3]
    limit = np.array([camera.width, camera.height]) - 1 - RIM_PX
    if rim[:, 2].min() < 0.1:
        return False
    px = cv2.projectPoints(rim, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0].reshape(-1, 2)
    return bool((px > RIM_PX).all() and (px < limit).all())


def _features(X_CM: Array, board: Board) -> Array:
    p = centre(X_CM, board)
    return np.array([p[0] / p[2], p[1] / p[2], np.log(p[2]), *tilt_and_turn(X_CM, board)])


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
    for view_corners in corners:
        column = np.clip(view_corners.px[:, 0] / camera.width * COLUMNS, 0, COLUMNS - 1).astype(int)
        row = np.clip(view_corners.px[:, 1] / camera.height * ROWS, 0, ROWS - 1).astype(int)
        np.add.at(cells, (row, column), 1)
    tilts = np.rad2deg(np.array([tilt_and_turn(X, board)[:2] for X in X_CM]).reshape(-1, 2))
    distances = np.array([np.linalg.norm(centre(X, board)) for X in X_CM])
    return Coverage(cells, tilts, distances, (*_tilts(tilts), *_distances(distances), *_cells(cells)))


def _tilts(tilts_deg: Array) -> list[str]:
    x, y = tilts_deg.T
    is_tilted = [(x > LEAN_DEG).any(), (x < -LEAN_DEG).any(), (y > LEAN_DEG).any(), (y < -LEAN_DEG).any()]
    return [f"tilt the board, {side}, by 20 to 40°" for side, ok in zip(_SIDES, is_tilted, strict=True) if not ok]


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
