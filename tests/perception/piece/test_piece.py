"""Finding the piece before a trial."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from table_scenes import AREA, at, box, close_up, food, studio

from perception.errors import ObjectNotFound
from perception.overlay import overlay_piece
from perception.piece import find_piece
from perception.piece.alone import find_alone
from perception.piece.detection import chromaticity, matte, without_halo
from sim.lab.kinect import kinect_model
from sim.types import Visual

SHAPES = {
    "cylinder": (0.0125, 0.0125, 0.0100),
    "ellipsoid": (0.0140, 0.0115, 0.0090),
    "box": (0.0110, 0.0130, 0.0090),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_place_size_and_shape_are_measured(shape: str) -> None:
    half = SHAPES[shape]
    scene = studio(food(shape, half), seed=3)
    xy = np.array([0.675, -0.021])
    found = find_piece(scene.still(at(xy[0], xy[1], half[2])), scene.model, scene.X_BC, AREA)
    assert np.linalg.norm(found.xy_m - xy) < 0.001
    assert np.abs(np.array(found.proxy.half_m) - half).max() < 0.001
    assert found.shape == shape
    assert found.confidence > 0.8
    assert found.height_m == pytest.approx(2 * half[2], abs=0.002)
    assert found.radius_m == pytest.approx((half[0] + half[1]) / 2, abs=0.001)


def test_contour_surrounds_the_piece_in_the_image() -> None:
    scene = studio(food("cylinder", (0.012, 0.012, 0.01)))
    frame = scene.still(at(0.68, 0.0, 0.01))
    found = find_piece(frame, scene.model, scene.X_BC, AREA)
    red = frame.colour[..., 0].astype(int) - frame.colour[..., 2] > 60
    rows, columns = np.nonzero(red)
    low, high = found.contour_px.min(axis=0), found.contour_px.max(axis=0)
    assert np.abs(low - [columns.min(), rows.min()]).max() <= 1
    assert np.abs(high - [columns.max(), rows.max()]).max() <= 1


def test_small_camera_is_enough_to_find_it() -> None:
    scene = studio(food("cylinder", (0.0125, 0.0125, 0.01)), model=kinect_model("small"))
    found = find_piece(scene.still(at(0.67, 0.02, 0.01)), scene.model, scene.X_BC, AREA)
    assert np.linalg.norm(found.xy_m - [0.67, 0.02]) < 0.003


def moved(visual: Visual, place_m: tuple[float, float, float]) -> Visual:
    return Visual("world", visual.vertices_m + np.array(place_m), visual.triangles, visual.rgb)


FOOD = food("cylinder", (0.012, 0.012, 0.01))


@pytest.mark.parametrize(
    ("visuals", "place_m", "said"),
    [
        ([FOOD], (0.68, 0.0, -1.0), r"nothing lies in x 0\.630 to 0\.730, y -0\.050 to 0\.050 m: no spot"),
        ([FOOD], (0.68, 0.065, 0.01), r"something lies at \(0\.6[78]\d, 0\.06\d\) m; move it into"),
        (
            [FOOD, moved(food("cylinder", (0.01, 0.01, 0.01)), (0.70, 0.03, 0.01))],
            (0.65, -0.03, 0.01),
            "2 objects lie in",
        ),
        (
            [box("piece", (-0.035, -0.035, -0.01), (0.035, 0.035, 0.01), FOOD.rgb)],
            (0.68, 0.0, 0.01),
            "a piece measures",
        ),
    ],
    ids=["bare table", "beside the area", "two pieces", "too large"],
)
def test_what_is_not_one_piece_in_its_area_is_refused_with_what_lies_where(
    visuals: list[Visual], place_m: tuple[float, float, float], said: str
) -> None:
    scene = studio(*visuals)
    with pytest.raises(ObjectNotFound, match=said):
        find_piece(scene.still(at(*place_m)), scene.model, scene.X_BC, AREA)


def test_a_second_piece_beside_the_area_is_refused_and_other_things_are_not() -> None:
    second, piece_m = moved(FOOD, (0.72, 0.12, 0.01)), at(0.68, 0.0, 0.01)
    scene = studio(FOOD, second)
    with pytest.raises(ObjectNotFound, match=r"colour and size lies at \(0\.7[12]\d, \+0\.1[12]\d\) m too"):
        find_alone(scene.still(piece_m), scene.model, scene.X_BC, AREA)
    scene = studio(FOOD, replace(second, rgb=(0.1, 0.2, 0.6)))
    assert find_alone(scene.still(piece_m), scene.model, scene.X_BC, AREA).confidence > 0.8


@pytest.mark.long
def test_overlay_draws_on_a_copy() -> None:
    scene = studio(food("cylinder", (0.012, 0.012, 0.01)))
    frame = scene.still(at(0.68, 0.0, 0.01))
    before = frame.colour.copy()
    found = find_piece(frame, scene.model, scene.X_BC, AREA)
    image = overlay_piece(frame, scene.model, scene.X_BC, found, AREA, np.array([0.70, 0.02]))
    assert image.dtype == np.uint8 and image.shape == frame.colour.shape
    assert np.array_equal(frame.colour, before)
    green = (image == (30, 220, 60)).all(axis=-1)
    u, v = found.contour_px.mean(axis=0)
    assert green[int(v) - 15 : int(v) + 15, int(u) - 15 : int(u) + 15].sum() > 20
    nothing = overlay_piece(frame, close_up(), scene.X_BC, None, AREA)
    assert (nothing != before).any() and not (nothing == (30, 220, 60)).all(axis=-1).any()


def test_jpeg_draws_no_rim_around_a_piece_on_a_black_tool() -> None:
    """Found on pictures of another renderer: the rim made pieces on the blade 2 px larger and moved them by 2 mm."""
    rgb, true = np.full((64, 64, 3), (16, 15, 17), np.uint8), np.zeros((64, 64), np.uint8)
    cv2.circle(rgb, (31, 32), 12, (165, 45, 20), -1, cv2.LINE_AA)
    cv2.circle(true, (31, 32), 12, 255, -1, cv2.LINE_AA)
    _, data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
    seen = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].copy()
    piece, tool = (chromaticity(np.array([colour], np.uint8))[0] for colour in ((165, 45, 20), (16, 15, 17)))
    share, area = matte(seen, piece, (tool,)), true.sum() / 255
    assert share.sum() > 1.15 * area, "else the test shows nothing"
    assert without_halo(share, seen, np.ones((64, 64), bool)).sum() == pytest.approx(area, rel=0.06)
    assert without_halo(share, seen, np.zeros((64, 64), bool)) == pytest.approx(share), "a shadow on the table stays"
