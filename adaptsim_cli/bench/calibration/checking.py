"""The checks besides the residuals, from a folder of views: depth images, the filmed swing, infrared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calib import checks as of
from calib import files, touch
from calib.errors import ViewFolderError
from calib.timing import time_offset
from calib.types import Check, Forward, Mounting, Setup, Solution, View
from hw.bounded import read_table
from hw.poses import inverse
from hw.types import Array, Intrinsics, frozen_array
from perception.board import find
from perception.board.types import Corners
from perception.errors import BoardNotFound

MOTION = "motion.json"
TABLE_X_M, TABLE_Y_M = (0.45, 1.0), (-0.35, 0.35)
"""The part of the table that is checked, in the base frame. What arm and board hide in one view is visible in others.
"""
TABLE_NEAR_M = 0.02
_EVERY_PX = 6
_MEDIAN_VIEWS = 5


def checks(
    folder: Path, stored: files.Folder, setup: Setup, views: Sequence[View], solution: Solution, forward: Forward | None
) -> list[Check]:
    """All checks, in the order of the screen. Raises ViewFolderError if the swing's file is damaged."""
    good = [view for view in views if view.name in set(solution.used)]
    predicted = of.board_poses(solution, good, setup, forward)
    poses = dict(zip([view.name for view in good], predicted, strict=True))
    X_CD, alignment = of.infrared_board(solution, views, setup, forward)
    all_checks = [of.square_size(solution), of.joint_offsets(solution), of.variety(solution), of.mirror_poses(solution)]
    all_checks += [of.weights(solution)]
    if stored.setup.X_HM is not None:
        all_checks += [of.mounting_of_board(solution, np.array(stored.setup.X_HM))]
    all_checks += [_depth(stored, setup, poses, X_CD), alignment, _table(stored, setup, solution, X_CD)]
    all_checks += [_timing(folder, setup, solution, forward), _touched(folder, setup, solution, forward)]
    return [*all_checks, of.warm_up(readings(stored, "camera"))]


def readings(stored: files.Folder, device: str) -> list[float]:
    """The device's temperatures in °C, in the order of the views that state it."""
    values = (view.record.temperatures_C.get(device) for view in stored.views)
    return [value for value in values if value is not None]


def _depth(stored: files.Folder, setup: Setup, poses: dict[str, Array], X_CD: Array | None) -> Check:
    camera, at = setup.infrared, X_CD if X_CD is not None else setup.X_CD
    if camera is None or at is None:
        return Check.unmeasured("depth bias", "the views have no depth images")
    residuals = [
        of.depth_residuals(inverse(at) @ poses[view.name], setup.board, view.depth_mm.astype(np.float64), camera)
        for view in stored.views
        if view.depth_mm is not None and view.name in poses
    ]
    return of.depth_bias(residuals)


def _table(stored: files.Folder, setup: Setup, solution: Solution, X_CD: Array | None) -> Check:
    camera, at = setup.infrared, X_CD if X_CD is not None else setup.X_CD
    images = [view.depth_mm for view in stored.views if view.depth_mm is not None]
    if camera is None or at is None or not images or solution.mounting is not Mounting.FIXED:
        return Check.unmeasured("table plane", "needs depth images of a camera that does not move")
    return of.table_plane(table_points(_behind(images), camera, solution.X_AC @ at))


def _behind(images: Sequence[Array | Any]) -> Array:
    """(H, W) depth in m of the static background: the median of the far half of a pixel's readings; 0 = none."""
    chosen = np.linspace(0, len(images) - 1, min(len(images), 2 * _MEDIAN_VIEWS + 1)).astype(int)
    stack = np.sort(np.stack([images[i] for i in chosen]).astype(np.float64), axis=0)
    return np.asarray(1e-3 * stack[-1 - len(chosen) // 4])


def table_points(depth_m: Array, camera: Intrinsics, X_BD: Array) -> Array:
    """(N, 3) readings near the table top within the checked part, in the base."""
    v, u = np.mgrid[0 : camera.height : _EVERY_PX, 0 : camera.width : _EVERY_PX].reshape(2, -1)
    pixels = np.stack([u, v], axis=1).astype(np.float64)
    flat = cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion).reshape(-1, 2)
    z = depth_m[v, u]
    points = (np.column_stack([flat, np.ones(len(flat))]) * z[:, None])[z > 0]
    p = points @ X_BD[:3, :3].T + X_BD[:3, 3]
    near = (np.abs(p[:, 2]) < TABLE_NEAR_M) & (p[:, 0] > TABLE_X_M[0]) & (p[:, 0] < TABLE_X_M[1])
    return np.asarray(p[near & (p[:, 1] > TABLE_Y_M[0]) & (p[:, 1] < TABLE_Y_M[1])])


def _touched(folder: Path, setup: Setup, solution: Solution, forward: Forward | None) -> Check:
    stored = files.read_touch(folder)
    if stored is None or setup.mounting is not Mounting.FIXED:
        return Check.unmeasured(touch.NAME, "no point was touched: that needs a person, or the simulated lab")
    record, colour = stored
    if record.corner >= setup.board.corners:
        raise ViewFolderError(
            f"{folder / files.TOUCH}: corner {record.corner}; this board has 0 to {setup.board.corners - 1}"
        )
    X_BF = record.flanges()
    if record.q_rad is not None:
        if forward is None:
            raise ViewFolderError(f"{folder / files.TOUCH} gives joints of an unknown arm: give X_BF")
        q_rad = np.array(record.q_rad)
        X_BF = forward(q_rad + solution.offsets_rad(q_rad.shape[1]))
    assert X_BF is not None  # the record has one of the two
    try:
        return touch.check(solution, setup, find(colour, setup.board, setup.colour), record.corner, X_BF)
    except BoardNotFound as error:
        return Check.unmeasured(touch.NAME, f"{record.image}: {error}")


def _timing(folder: Path, setup: Setup, solution: Solution, forward: Forward | None) -> Check:
    path = folder / MOTION
    if not path.exists() or forward is None:
        return Check.unmeasured("time offset", "no swing of the board was filmed")
    frames, arm_t_s, q_rad = read_motion(path)
    return time_offset(frames, arm_t_s, q_rad, solution, setup, forward)


def read_motion(path: Path) -> tuple[list[tuple[float, Corners]], Array, Array]:
    """Frames (time stamp, corners), and the arm's log (M,), (M, 7) of the filmed swing. Raises ViewFolderError."""
    try:
        data = read_table(path)
        frames = [(float(f["t_s"]), Corners(np.array(f["ids"]), np.array(f["px"]))) for f in data["frames"]]
        arm_t_s = frozen_array(data["arm_t_s"], (None,), "arm_t_s")
        return frames, arm_t_s, frozen_array(data["q_rad"], (len(arm_t_s), 7), "q_rad")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ViewFolderError(
            f"{path} is damaged ({error}); remove it; the time offset is then not measured"
        ) from error
