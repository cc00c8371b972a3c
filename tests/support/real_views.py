"""Real views as somebody else's program would write them: a Panda before three RealSense cameras (tests/data)."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib.foreign.sizing import solve_any_size
from calib.geometry import difference
from calib.types import Mounting, Setup, Solution, View
from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.poses import pose
from hw.types import Array, Intrinsics
from perception.board.targets import single
from perception.board.types import Corners

DATA = Path(__file__).parents[1] / "data" / "panda-realsense"
_RECORDED = json.loads((DATA / "views.json").read_text())
POSTURES = 20
MARKER = single("4x4_50", 9, 0.05)  # its size is not told: only the shape counts

PoseKeys = Mapping[str, Any]


X_BF = np.stack(
    [
        pose(Rotation.from_quat(told["quaternion_xyzw"]).as_matrix(), told["position_m"])
        for told in _RECORDED["flange_poses_in_base"]
    ]
)


def camera(number: int) -> Intrinsics:
    told = _RECORDED["intrinsics"][number]
    K = np.array([[told["fx"], 0, told["ppx"]], [0, told["fy"], told["ppy"]], [0, 0, 1.0]])
    return Intrinsics(640, 480, K)


def corners(number: int) -> dict[int, Array]:
    """The marker's corners (4, 2) by posture, of those postures in which this camera sees it."""
    return {i: np.array(px) for i, px in enumerate(_RECORDED["corners_px"][number]) if px is not None}


def setup(number: int) -> Setup:
    return Setup(Mounting.FIXED, MARKER, camera(number), size_known=False)


def views(number: int) -> list[View]:
    return [View(f"{i:02d}", Corners(np.arange(4), px), X_BF=X_BF[i]) for i, px in sorted(corners(number).items())]


@cache
def solved(number: int) -> tuple[Solution, Setup]:
    """One camera by itself, and its setup with the size that was found."""
    return solve_any_size(views(number), setup(number), None)


def as_told(X: Array) -> PoseKeys:
    """As the recording gives it."""
    x, y, z, w = Rotation.from_matrix(X[:3, :3]).as_quat().tolist()
    return {"position_m": X[:3, 3].tolist(), "quaternion_xyzw": [x, y, z, w]}


def setup_toml(number: int, board: str, extra: str = "", mounting: str = "fixed") -> str:
    K = camera(number).K.tolist()
    return f'camera = "{mounting}"\n{extra}\n[board]\n{board}\n\n[colour]\nwidth = 640\nheight = 480\nK = {K}\n'


POINTS = 'kind = "points"\nsize = "unknown"'
ARUCO = 'kind = "marker"\ndictionary = "4x4_50"\nid = 9\nmarker_mm = 50.0\nsize = "unknown"'


def corner_folder(
    folder: Path,
    number: int = 2,
    pose: Callable[[int], PoseKeys] = lambda i: as_told(X_BF[i]),
    extra: str = "",
    board: str = POINTS,
) -> Path:
    """Views with corners found elsewhere, no pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(setup_toml(number, board, extra))
    points = (1e3 * MARKER.p_MK_m).tolist()
    for i, px in corners(number).items():
        record = {"corners_px": px.tolist(), "points_mm": points, **pose(i)}
        (folder / f"view-{i:02d}.json").write_text(json.dumps(record))
    return folder


def picture_folder(folder: Path, pose: Callable[[int], PoseKeys] = lambda i: as_told(X_BF[i])) -> Path:
    """The twenty pictures of camera 2 with the poses beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(setup_toml(2, ARUCO))
    for i in range(POSTURES):
        shutil.copy(DATA / f"camera-2-{i:02d}.jpg", folder / f"{i:02d}.jpg")
        record = {"image": f"{i:02d}.jpg", **pose(i)}
        (folder / f"view-{i:02d}.json").write_text(json.dumps(record))
    return folder


@cache
def postures_rad() -> Array:
    """(20, 7) joints under which our Panda's flange is at `X_BF`; the recording tells none."""
    rest = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8])
    limits = LIMITS["panda"]

    def off(q: Array, X: Array) -> Array:
        twist = difference(X, forward(q))
        return np.concatenate([twist[:3], 2.0 * twist[3:], 1e-7 * (q - rest)])

    found = []
    for X in X_BF:
        tries = [rest + np.array([turn, 0, 0, 0, 0, 0, 0]) for turn in (0.0, 0.5, -0.5)]
        fits = [
            least_squares(off, q, args=(X,), bounds=(limits.q_min_rad, limits.q_max_rad), xtol=1e-14) for q in tries
        ]
        found.append(min(fits, key=lambda fit: fit.cost).x)
    q_rad = np.stack(found)
    assert np.abs(forward(q_rad) - X_BF).max() < 1e-5
    return q_rad


def room_corners() -> list[dict[int, Array]]:
    """Of each marker that lies still in the room, its corners (4, 2) by camera."""
    rows = _RECORDED["room_corners_px"].values()
    return [{k: np.array(px) for k, px in enumerate(row) if px is not None} for row in rows]
