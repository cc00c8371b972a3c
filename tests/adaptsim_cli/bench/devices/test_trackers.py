"""Which tracker a task gets, and what the bottle's says of contexts, marks and outcomes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bottle_scenes import BODY, MARK, bottle, stage

from adaptsim_cli.bench.devices.trackers import TRACKERS, tracker_of
from hw.types import CameraModel, Frame
from perception.errors import ObjectNotFound
from perception.types import Outcome
from sim.errors import UnknownName
from sim.lab.kinect import kinect_model
from sim.tasks import get_task
from sim.tasks.pushing.params import START_M, goal_m


def test_an_unknown_tracker_is_refused_with_the_known_ones():
    task = get_task("pushing")
    with pytest.raises(UnknownName, match=r"'cloth'.*piece, bottle"):
        tracker_of(replace(task, hardware=replace(task.require_hardware(), tracker="cloth")))


def test_a_bottle_is_placed_on_its_mark_whatever_the_goal():
    tracker = tracker_of(get_task("pushing"))
    goal = np.array([0.9, 0.1])
    assert tracker.placement(goal) == pytest.approx(START_M)
    assert tracker.context(goal, None) == pytest.approx(goal)
    assert goal_m(goal)[0] == pytest.approx(0.9)  # drawn in metres
    assert tracker.outcomes == (Outcome.UPRIGHT, Outcome.TIPPED, Outcome.LOST)


def test_a_piece_of_food_lies_where_the_context_says():
    tracker = tracker_of(get_task("scooping"))
    assert tracker.placement(np.array([0.68, 0.01])) == pytest.approx([0.68, 0.01])


def test_a_picture_is_searched_once_and_another_one_again():
    searched = []

    def find(frame: Frame, model: CameraModel, X_BC: np.ndarray) -> Any:
        searched.append(frame.t_s)
        return f"found at {frame.t_s}"

    made = tracker_of(get_task("scooping"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(TRACKERS, "piece", lambda task: replace(made, find=find))
        tracker = tracker_of(get_task("scooping"))
    picture = Frame(1.0, np.zeros((4, 4, 3), np.uint8), np.full((4, 4), 700, np.uint16))
    model, X_BC = kinect_model("small"), np.eye(4)
    stored = replace(picture, t_s=2.0, colour=picture.colour.copy())
    assert tracker.find(picture, model, X_BC) == tracker.find(stored, model, X_BC.copy()) == "found at 1.0"
    moved, nearer = np.diag([1.0, 1.0, 1.0, 1.0 + 1e-9]), replace(stored, depth_mm=picture.depth_mm - 1)
    assert tracker.find(stored, model, moved) == tracker.find(nearer, model, moved) == "found at 2.0"
    assert searched == [1.0, 2.0, 2.0]


def test_a_bottle_more_than_five_millimetres_beside_its_mark_is_refused():
    seen, tracker = stage(bottle()), tracker_of(get_task("pushing"))

    def find(off_m: float) -> None:
        where = BODY.upright(MARK + np.array([off_m, 0.0]))
        tracker.find(seen.shot(0.0, bottle=where), seen.model, seen.X_BC)

    find(0.004)
    with pytest.raises(ObjectNotFound, match="5 mm are allowed"):
        find(0.006)
