"""Targets other than our own board, as OpenCV draws and finds them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import real_views
from board_scenes import pose, project
from simulated_views import KINECT

from hw.types import Array
from perception.board import draw, find, locate
from perception.board.detection import dictionary_named
from perception.board.targets import Chessboard, Circles, Markers, Points, marker_grid, single
from perception.board.types import Board, CalibrationTarget
from perception.errors import BoardNotFound, WrongBoard

PX = 2000.0  # of the prints, a metre
MARGIN = 60


def printed(target: CalibrationTarget) -> tuple[np.ndarray, Array]:
    """(H, W) the print, and (2,) where in it the target's origin lies."""
    low = target.outline_m[:, :2].min(axis=0)
    size = np.ceil(PX * np.ptp(target.outline_m[:, :2], axis=0)).astype(int) + 2 * MARGIN
    image = np.full((size[1], size[0]), 255, np.uint8)
    origin = MARGIN - PX * low
    if isinstance(target, Markers):
        for number, corners in zip(target.ids, target.corners_m, strict=True):
            edge = round(PX * target.spacing_m)
            ink = cv2.aruco.generateImageMarker(dictionary_named(target.dictionary), number, edge)
            u, v = np.rint(origin + PX * corners[0, :2]).astype(int)
            image[v : v + edge, u : u + edge] = ink
    elif isinstance(target, Circles):
        for p in target.p_MK_m:
            u, v = 16 * (origin + PX * p[:2])
            cv2.circle(image, (round(u), round(v)), round(16 * 0.3 * PX * target.spacing_m), 0, -1, cv2.LINE_AA, 4)
    elif isinstance(target, Chessboard):
        step = PX * target.square_m
        for row in range(target.squares_down):
            for column in range(row % 2, target.squares_across, 2):
                u, v = np.rint(MARGIN + step * np.array([column, row])).astype(int)
                image[v : v + round(step), u : u + round(step)] = 0
    return image, origin - 0.5


def seen(target: CalibrationTarget, X_CM: Array) -> np.ndarray:
    """(H, W) the print at X_CM before a grey wall, by a camera without distortion."""
    image, origin = printed(target)
    to_target = np.array([[1 / PX, 0, -origin[0] / PX], [0, 1 / PX, -origin[1] / PX], [0, 0, 1]])
    H = KINECT.K @ X_CM[:3, [0, 1, 3]] @ to_target
    fine = np.array([[3, 0, 1.0], [0, 3, 1.0], [0, 0, 1]])
    big = cv2.warpPerspective(image, fine @ H, (3 * KINECT.width, 3 * KINECT.height), borderValue=120)
    return cv2.resize(big, (KINECT.width, KINECT.height), interpolation=cv2.INTER_AREA)


FLAT = replace(KINECT, distortion=np.zeros(8))


@pytest.mark.parametrize(
    "target",
    [
        single("4x4_50", 9, 0.08),
        single("apriltag_36h11", 17, 0.08),
        marker_grid("5x5_100", 4, (3, 2), 0.05, 0.02),
        marker_grid("apriltag_25h9", 0, (2, 2), 0.06, 0.03),
        Chessboard(9, 6, 0.03),
        Circles(7, 5, 0.03),
        Circles(4, 9, 0.02, staggered=True),
    ],
    ids=lambda target: target.name,
)
def test_it_is_found_where_it_is(target: CalibrationTarget) -> None:
    middle = target.outline_m.mean(axis=0)
    X_CM = pose(Board(), (0.0, 0.0, 0.7), (15.0, -25.0, 10.0))
    X_CM[:3, 3] = np.array([0.03, -0.02, 0.7]) - X_CM[:3, :3] @ middle
    found = find(seen(target, X_CM), target, FLAT)
    assert len(found) == target.corners
    truth = project(FLAT, X_CM, target.p_MK_m)
    off = min(
        float(np.sqrt(np.mean(np.sum((found.px - truth[ids]) ** 2, axis=1))))
        for ids in (np.arange(target.corners), *target.turns)
    )
    assert off < (0.1 if isinstance(target, Markers) else 0.4)
    tall = target.scaled(2.0)
    np.testing.assert_allclose(tall.p_MK_m, 2.0 * target.p_MK_m)
    assert locate(found, target, FLAT).rms_px < 0.4


@pytest.mark.parametrize("target", [single("4x4_50", 9, 0.08), Chessboard(9, 6, 0.03), Circles(7, 5, 0.03)])
def test_a_picture_without_it_is_named(target: CalibrationTarget) -> None:
    with pytest.raises(BoardNotFound, match="picture"):
        find(np.full((KINECT.height, KINECT.width), 120, np.uint8), target, FLAT)


def test_another_marker_is_named() -> None:
    X_CM = np.eye(4)
    X_CM[2, 3] = 0.6
    with pytest.raises(BoardNotFound, match="but markers 9 are"):
        find(seen(single("4x4_50", 9, 0.08), X_CM), single("4x4_50", 8, 0.08), FLAT)


def test_points_are_never_looked_for() -> None:
    with pytest.raises(BoardNotFound, match="give corners_px"):
        find(np.zeros((KINECT.height, KINECT.width), np.uint8), Points(np.eye(3)), FLAT)


def test_the_legacy_pattern_is_another_board() -> None:
    legacy = Board(6, 4, legacy=True)
    ink = draw(legacy, 60, 40)
    camera = replace(FLAT, width=ink.shape[1], height=ink.shape[0])
    assert len(find(ink, legacy, camera)) == legacy.corners
    with pytest.raises((BoardNotFound, WrongBoard)):
        find(ink, Board(6, 4), camera)


def test_a_real_marker_of_twenty_pixels() -> None:
    image = cv2.imread(str(real_views.DATA / "camera-2-00.jpg"))[..., ::-1]
    found = find(np.ascontiguousarray(image), real_views.MARKER, real_views.camera(2))
    np.testing.assert_allclose(found.px, real_views.corners(2)[0], atol=0.01)


def test_a_bent_print_and_a_lens_that_is_not_stated_do_not_cost_the_view() -> None:
    """Markers up to five pixels off the plane of the others are still those of the board."""
    board = Board()
    ink = draw(board, 90, 60)
    height, width = ink.shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    bent = cv2.remap(
        ink, u, v + 9.0 * np.sin(np.pi * u / width).astype(np.float32) ** 2, cv2.INTER_LINEAR, borderValue=255
    )
    camera = replace(FLAT, width=width, height=height)
    found = find(bent, board, camera)
    assert len(found) >= 20
    assert locate(found, board, camera).rms_px > 1.0
