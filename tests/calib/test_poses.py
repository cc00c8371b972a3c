"""Where the board is held, and what an operator is told is missing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.poses import RIM_PX, candidates, centre, coverage, spread, tilt_and_turn
from hw.types import Array, Intrinsics
from perception.board.types import Board, Corners

BOARD = Board()
CAMERA = Intrinsics(1280, 720, np.array([[612.0, 0, 639.0], [0, 612.0, 366.0], [0, 0, 1]]))


def board_at(p_m: tuple[float, float, float], rotation: Rotation | None = None) -> Array:
    """The board's centre at a point before the camera, square to its axis but for `rotation`."""
    X = np.eye(4)
    X[:3, :3] = (rotation or Rotation.identity()).as_matrix()
    X[:3, 3] = np.array(p_m) - X[:3, :3] @ np.array([*np.array(BOARD.size_m) / 2, 0])
    return X


def seen(X_CM: Array) -> Corners:
    p = BOARD.p_MK_m @ X_CM[:3, :3].T + X_CM[:3, 3]
    px = cv2.projectPoints(p, np.zeros(3), np.zeros(3), CAMERA.K, CAMERA.distortion)[0].reshape(-1, 2)
    return Corners(np.arange(BOARD.corners), px)


def test_candidates_are_in_the_image_and_the_same_every_time() -> None:
    X_CM = candidates(CAMERA, BOARD, 256, (0.5, 1.1))
    assert 40 < len(X_CM) <= 256
    for X in X_CM:
        px = seen(X).px
        assert (px > RIM_PX).all()
        assert (px < np.array([1280, 720]) - RIM_PX).all()
        assert 0.5 <= np.linalg.norm(centre(X, BOARD)) <= 1.1
    assert np.array_equal(X_CM, candidates(CAMERA, BOARD, 256, (0.5, 1.1)))


def test_chosen_poses_lack_nothing() -> None:
    X_CM = candidates(CAMERA, BOARD, 256, (0.5, 1.1))
    chosen = X_CM[spread(X_CM, BOARD, 20)]
    found = coverage([seen(X) for X in chosen], list(chosen), BOARD, CAMERA)
    assert found.complete, found.missing
    tilts = np.linalg.norm(found.tilts_deg, axis=1)
    assert tilts.min() > 10


@pytest.mark.parametrize(
    ("axis", "angle_deg", "side"),
    [
        ("x", 25, "its top towards"),
        ("x", -25, "its top away"),
        ("y", 25, "its left side away"),
        ("y", -25, "its right side away"),
    ],
)
def test_hints_name_the_side_that_is_missing(axis: str, angle_deg: float, side: str) -> None:
    X = board_at((0, 0, 0.8), Rotation.from_euler(axis, angle_deg, degrees=True))
    corner = {
        "its top towards": BOARD.outline_m[:2],
        "its top away": BOARD.outline_m[:2],
        "its left side away": BOARD.outline_m[[0, 3]],
        "its right side away": BOARD.outline_m[1:3],
    }[side]
    depth = (corner @ X[:3, :3].T + X[:3, 3])[:, 2].mean()
    assert (depth > 0.8) == ("away" in side), "the board really leans to that side"
    told = " ".join(coverage([seen(X)], [X], BOARD, CAMERA).missing)
    assert side not in told
    others = {"its top towards", "its top away", "its left side away", "its right side away"} - {side}
    assert all(other in told for other in others)


def test_tilts_are_those_about_the_line_of_sight_wherever_the_board_is() -> None:
    X = board_at((0, 0, 0.8), Rotation.from_euler("XZ", [30, 10], degrees=True))
    x, y, turn = np.rad2deg(tilt_and_turn(X, BOARD))
    assert x == pytest.approx(30, abs=1)
    assert y == pytest.approx(0, abs=1)
    assert turn == pytest.approx(10, abs=2)


def test_one_distance_and_one_corner_are_not_enough() -> None:
    X_CM = [board_at((0.3, 0.1, 0.8), Rotation.from_euler(a, s * 25, degrees=True)) for a in "xy" for s in (1, -1)]
    told = coverage([seen(X) for X in X_CM], X_CM, BOARD, CAMERA).missing
    assert any("all views are 0.8" in hint for hint in told)
    assert any("it has not been at top left" in hint for hint in told)
