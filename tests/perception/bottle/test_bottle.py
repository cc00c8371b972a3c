"""Finding the bottle before a push: what is accepted, and what is said of everything else."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest
from bottle_scenes import AREA, BODY, HAND, MARK, Stage, bottle, leaning, stage, up
from table_scenes import at, box

from hw.types import Array
from perception.bottle import BottleDetection, find_bottle
from perception.errors import ObjectNotFound, TableNotFound
from perception.overlay import overlay_bottle


@lru_cache
def scene() -> Stage:
    cube = box("cube", (-0.04, -0.04, -0.03), (0.04, 0.04, 0.03), (0.3, 0.3, 0.3))
    return stage(bottle(), bottle("other"), HAND, cube, seed=2)


def find(X_BC: Array | None = None, **poses: Array) -> BottleDetection:
    s = scene()
    return find_bottle(s.shot(0.0, **poses), s.model, s.X_BC if X_BC is None else X_BC, BODY, AREA, MARK)


def test_a_bottle_on_its_mark_is_found_to_a_fraction_of_a_millimetre() -> None:
    found = find(bottle=up(0.563, -0.003))
    assert np.linalg.norm(found.xy_m - [0.563, -0.003]) < 0.0007
    assert found.confidence > 0.95


def test_the_table_takes_out_most_of_a_tilted_camera() -> None:
    off = np.eye(4)
    off[:3, :3], _ = cv2.Rodrigues(np.deg2rad([0.2, 0.0, 0.0]))
    tilted = scene().X_BC @ off
    found = find(tilted, bottle=up(0.56, 0.0))
    assert np.linalg.norm(found.xy_m - MARK) < 0.0015
    assert np.rad2deg(found.table.turned_rad) == pytest.approx(0.2, abs=0.06)


@pytest.mark.parametrize(
    ("poses", "said"),
    [
        ({}, r"no bottle: nothing stands in .* put it on its mark at \(0\.560, \+0\.000\) m"),
        (
            {"bottle": up(0.58, -0.013)},
            "24 mm from its mark .* move it 20 mm towards the robot and 13 mm to the .* left",
        ),
        ({"bottle": up(0.56, 0), "other": up(0.7, 0.1)}, "2 bottles are on the table"),
        ({"bottle": leaning(MARK, np.pi / 2 - 1e-6)}, "lies on its side; stand it on its mark"),
        ({"bottle": up(0.56, 0), "hand": at(0.75, 0.15, 0.08)}, r"beside the bottle there is something at \(0\.7"),
        ({"bottle": up(0.56, 0), "hand": at(0.56, 0.078, 0.05)}, "something touches or hides the bottle"),
        ({"bottle": up(0.56, 0), "hand": at(0.56, 0.0, 0.13)}, "something .* keep hands and other things away"),
        ({"cube": at(0.6, 0.05, 0.03)}, r"no bottle \(6 cm wide and 10 cm high\) .* but something at .* 6 cm high"),
        ({"bottle": up(1.20, 0)}, "beyond the edge of the depth image"),
    ],
)
def test_anything_else_is_refused_with_what_to_do(poses: dict[str, Array], said: str) -> None:
    with pytest.raises(ObjectNotFound, match=said):
        find(**poses)


def test_a_camera_that_was_moved_is_noticed_at_the_table() -> None:
    off = np.eye(4)
    off[2, 3] = 0.02
    with pytest.raises(TableNotFound, match="calibrate it again"):
        find(scene().X_BC @ off, bottle=up(0.56, 0))


@pytest.mark.long
def test_overlay_shows_mark_goal_and_bottle_on_a_copy() -> None:
    s = scene()
    frame = s.photo(bottle=up(0.56, 0.0))
    before = frame.colour.copy()
    found = find_bottle(frame, s.model, s.X_BC, BODY, AREA, MARK)
    image = overlay_bottle(frame, s.model, s.X_BC, found, BODY, MARK, np.array([0.9, 0.05]))
    assert np.array_equal(frame.colour, before)
    assert image.shape == before.shape and image.dtype == np.uint8
    for rgb in ((30, 220, 60), (70, 130, 255), (255, 60, 60)):
        assert (image == rgb).all(axis=-1).sum() > 30
    changed = np.argwhere((image != before).any(axis=-1))
    assert changed[:, 0].max() > changed[:, 0].min() + 150  # the goal lies nearer to the camera than the bottle
