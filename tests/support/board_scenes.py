"""The board in an image, exactly: every sample of every pixel is traced through the lens onto the print."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hw import poses
from hw.types import Array, Intrinsics
from perception.board import draw
from perception.board.types import Board

INFRARED = Intrinsics(
    640,
    576,
    np.array([[504.6, 0, 332.8], [0, 504.7, 348.8], [0, 0, 1]]),
    np.array([0.54794, -0.02097, 0.00002, -0.00007, -0.00265, 0.88968, 0.08613, -0.01391]),
)
_SQUARE_PX, _SAMPLES = 80, 4


def pose(board: Board, centre_m: tuple[float, float, float], angles_deg: tuple[float, float, float]) -> Array:
    """X_CM (4, 4): turned about the line of sight, then tilted about Y and X."""
    R = Rotation.from_euler("zyx", angles_deg, degrees=True).as_matrix()
    return poses.pose(R, np.array(centre_m) - R @ board.outline_m.mean(axis=0))


def render(
    board: Board, camera: Intrinsics, X_CM: Array, rng: np.random.Generator, noise: float = 2.0
) -> NDArray[np.uint8]:
    """(H, W) grey image of the print with a white margin, on a grey ground."""
    margin = _SQUARE_PX
    print_ = draw(board, _SQUARE_PX, margin).astype(np.float32)
    rim = board.square_m
    outer = board.outline_m + rim * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    uv = project(camera, X_CM, outer)
    low = np.clip(np.floor(uv.min(axis=0)).astype(int) - 2, 0, [camera.width - 1, camera.height - 1])
    high = np.clip(np.ceil(uv.max(axis=0)).astype(int) + 2, 0, [camera.width - 1, camera.height - 1])
    inside = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    u = (np.arange(low[0], high[0] + 1)[:, None] + inside).ravel()
    v = (np.arange(low[1], high[1] + 1)[:, None] + inside).ravel()
    nodes = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 1e-7)
    flat = cv2.undistortPointsIter(nodes, camera.K, camera.distortion, np.eye(3), np.eye(3), stop).reshape(-1, 2)
    rays = np.column_stack([flat, np.ones(len(flat))])
    met = rays * ((X_CM[:3, 2] @ X_CM[:3, 3]) / (rays @ X_CM[:3, 2]))[:, None]
    on_print = ((met - X_CM[:3, 3]) @ X_CM[:3, :2] / board.square_m * _SQUARE_PX + margin - 0.5).astype(np.float32)
    shape = (len(v), len(u))
    value = cv2.remap(
        print_, on_print[:, 0].reshape(shape), on_print[:, 1].reshape(shape), cv2.INTER_LINEAR, borderValue=110
    )
    value = value.reshape(len(v) // _SAMPLES, _SAMPLES, len(u) // _SAMPLES, _SAMPLES).mean(axis=(1, 3))
    image = np.full((camera.height, camera.width), 110.0)
    image[low[1] : high[1] + 1, low[0] : high[0] + 1] = value
    image = 40.0 + 0.7 * image + rng.normal(0.0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def project(camera: Intrinsics, X_CM: Array, points_M_m: Array) -> Array:
    uv, _ = cv2.projectPoints(points_M_m, cv2.Rodrigues(X_CM[:3, :3])[0], X_CM[:3, 3], camera.K, camera.distortion)
    return np.asarray(uv, dtype=np.float64).reshape(-1, 2)
