"""Views recorded elsewhere: other cameras, other robots, the camera on the wrist; and what is written by hand."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_rig import picture
from scipy.spatial.transform import Rotation

from adaptsim_cli.bench.calibration import solving
from calib.errors import ViewFolderError
from calib.files import read_folder
from calib.poses import candidates, spread
from hw.types import Array, Intrinsics
from perception.board.types import Board

BOARD = Board(8, 6, 0.025, 0.018)
CAMERA = Intrinsics(800, 600, np.array([[700.0, 0, 405.0], [0, 702.0, 296.0], [0, 0, 1]]))
X_FC = np.eye(4)
X_FC[:3, :3] = Rotation.from_euler("xyz", [5, -3, 92], degrees=True).as_matrix()
X_FC[:3, 3] = 0.05, -0.02, 0.06
X_BM = np.eye(4)
X_BM[:3, :3] = Rotation.from_euler("xyz", [178, 2, 30], degrees=True).as_matrix()
X_BM[:3, 3] = 0.5, 0.1, 0.02

SETUP = """
camera = "wrist"

[board]
squares_across = 8
squares_down = 6
square_mm = 25.0
marker_mm = 18.0
dictionary = "4x4_50"

[colour]
width = 800
height = 600
K = [[700.0, 0.0, 405.0], [0.0, 702.0, 296.0], [0.0, 0.0, 1.0]]
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
"""


def pose(X: Array) -> dict[str, object]:
    x, y, z, w = Rotation.from_matrix(X[:3, :3]).as_quat()
    return {"position_m": X[:3, 3].tolist(), "quaternion_wxyz": [w, x, y, z]}


@pytest.fixture(scope="module")
def wrist(tmp_path_factory) -> Path:
    """A folder as someone with another robot would write it: JPEG pictures, poses as position and quaternion."""
    folder = tmp_path_factory.mktemp("wrist")
    (folder / "setup.toml").write_text(SETUP)
    X_CM = candidates(CAMERA, BOARD, 128, (0.35, 0.7))
    for k, i in enumerate(spread(X_CM, BOARD, 14)):
        cv2.imwrite(str(folder / f"shot{k:02d}.jpg"), picture(X_CM[i], BOARD, CAMERA, seed=k)[..., ::-1])
        X_BF = X_BM @ np.linalg.inv(X_CM[i]) @ np.linalg.inv(X_FC)
        (folder / f"view-{k:02d}.json").write_text(json.dumps({"image": f"shot{k:02d}.jpg", **pose(X_BF)}))
    return folder


def test_a_camera_on_the_wrist_of_any_robot(wrist):
    solved = solving.solve_folder(wrist)
    X = np.array(solved.record.X_AC)
    assert 1e3 * np.linalg.norm(X[:3, 3] - X_FC[:3, 3]) < 1.0
    assert np.rad2deg(Rotation.from_matrix(X[:3, :3].T @ X_FC[:3, :3]).magnitude()) < 0.1
    assert solved.record.mounting == "wrist"
    assert solved.record.accepted
    assert np.array(solved.record.X_HM) == pytest.approx(X_BM, abs=2e-3)
    with pytest.raises(ValueError, match="wrist"):
        solved.record.hand_eye()


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ({"position_m": [512.0, 100.0, 300.0], "quaternion_wxyz": [1, 0, 0, 0]}, "metres, not mm"),
        ({"position_m": [0.5, 0.1, 0.3], "quaternion_wxyz": [1, 1, 0, 0]}, "of length 1"),
        ({"position_m": [0.5, 0.1, 0.3]}, "needed together"),
        ({"q_rad": [0, -45, 0, -135, 0, 90, 45]}, "not in degrees"),
        ({"q_rad": [0.0] * 7}, "joints of an unknown arm"),
        ({"X_BF": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "right-handed"),
        ({"X_BF": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "four rows of four"),
        ({}, "exactly one of"),
        ({"q_rad": [0.0] * 7, "position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}, "exactly one of"),
        ({"q_rad": [0.0] * 7, "image": "../other/shot.jpg"}, "without a folder"),
    ],
)
def test_what_is_swapped_or_mistyped_is_named(view, message, tmp_path):
    (tmp_path / "setup.toml").write_text(SETUP)
    (tmp_path / "view-1.json").write_text(json.dumps({"image": "shot.jpg", **view}))
    with pytest.raises(ViewFolderError, match=message):
        read_folder(tmp_path)
