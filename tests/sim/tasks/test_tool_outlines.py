"""A tool lies inside of its outline: spatula and adapter, pusher, calibration board."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from arm_meshes import Body
from capsule_gaps import outside_m

from hw.capsules import Capsule
from hw.kinematics import FLANGE
from sim.lab.board import HeldBoard
from sim.tasks import get_task
from sim.tasks.pushing.mount import pusher_visuals
from sim.tasks.scooping.spatula import spatula_visuals
from sim.types import Visual


def farthest_m(visuals: Iterable[Visual], capsules: tuple[Capsule, ...]) -> float:
    bodies = (Body(v.body, FLANGE, v.vertices_m[v.triangles]) for v in visuals)
    return max(float(outside_m(body.points_m(0.004), capsules).max()) for body in bodies)


@pytest.mark.parametrize(
    ("task", "visuals"),
    [("scooping", spatula_visuals("blade", "handle")), ("pushing", pusher_visuals("pusher"))],
    ids=["scooping", "pushing"],
)
def test_a_tasks_tool_lies_inside_of_its_outline(task: str, visuals: tuple[Visual, ...]) -> None:
    hardware = get_task(task).require_hardware()
    assert farthest_m(visuals, (*hardware.keep_clear, *hardware.may_touch)) < 1e-6


def test_the_calibration_board_lies_inside_of_its_outline() -> None:
    board = HeldBoard(np.zeros((20, 28), np.uint8), (0.28, 0.20))
    assert farthest_m(board.visuals(), board.tool().capsules) < 1e-6
