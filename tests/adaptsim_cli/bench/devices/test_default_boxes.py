"""The boxes that a rig file has by itself (camera, the person's side) leave the work area to the arm.

A trial counts as direct where its three paths are those of a lab without boxes, as detoured where the boxes change
them, as refused where there is none.
"""

from __future__ import annotations

from collections import Counter
from itertools import product

import numpy as np
import pytest

from adaptsim_cli.bench.devices.mounted import MountedTask, mounted_as_shipped, mounted_task_of
from adaptsim_cli.bench.rig_file.description import Model, PersonPart, as_shipped
from hw.collision import KeepOut, Side, camera_box
from hw.types import Array
from sim.errors import NotExecutable
from sim.lab.kinect import default_X_BC
from sim.tasks import get_task
from sim.tasks.task import Task


def boxes(side: Side, from_m: float | None = None) -> tuple[KeepOut, ...]:
    person = PersonPart(side) if from_m is None else PersonPart(side, from_m)
    return camera_box(default_X_BC()), person.box()


def grid(points: int) -> list[tuple[float, ...]]:
    return list(product(np.linspace(0.0, 1.0, points), repeat=2))


CORNERS = grid(2)
LEFT = [corner for corner in CORNERS if corner[1] == 1.0]


def trials(task: Task, unit: list[tuple[float, ...]]) -> list[tuple[Array, Array]]:
    """(context, action) over the area that the task works in: where the food lies, or how the bottle is pushed."""
    if task.name == "scooping":
        middle = task.action.middle
        return [(task.context.denormalise(np.array(u)), middle) for u in unit]
    return [(task.reference_context, task.action.denormalise(np.array(u))) for u in unit]


def counted(name: str, model: Model, keep_out: tuple[KeepOut, ...], unit: list[tuple[float, ...]]) -> Counter[str]:
    """How many trials are direct, detoured and refused."""
    task = get_task(name)
    without = mounted_as_shipped(task, model)
    within = mounted_task_of(task, as_shipped(model), np.zeros(7), keep_out)
    return Counter(_way(without, within, *trial) for trial in trials(task, unit))


def _way(without: MountedTask, within: MountedTask, context: Array, action: Array) -> str:
    motion = without.hardware.plan(context, action)
    free = without.paths(motion)
    try:
        found = within.paths(motion)
    except NotExecutable as error:
        assert "camera" in str(error) or "person's side" in str(error), "what is in the way is named"
        return "refused"
    for path in found:
        within.cell.require(path)
    return "direct" if all(np.array_equal(a.q_rad, b.q_rad) for a, b in zip(free, found, strict=True)) else "detoured"


@pytest.mark.long
def test_beside_the_person_the_food_is_reached_as_if_there_were_no_boxes():
    assert counted("scooping", "panda", boxes("left"), LEFT) == {"direct": 2}


@pytest.mark.slow
@pytest.mark.parametrize("side", ["left", "right", "back"])
@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize("name", ["scooping", "pushing"])
def test_a_grid_is_reached_from_every_side_at_which_a_person_can_stand(name, model, side):
    assert counted(name, model, boxes(side), grid(3)) == {"direct": 9}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scooping", "pushing"])
def test_a_person_in_front_would_stand_in_the_work_area_and_every_trial_says_so(name):
    assert counted(name, "panda", boxes("front"), CORNERS) == {"refused": 4}


@pytest.mark.slow
@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize("name", ["scooping", "pushing"])
def test_the_corners_are_reached_as_if_there_were_no_boxes(name: str, model: Model) -> None:
    assert counted(name, model, boxes("left"), CORNERS) == {"direct": 4}
