"""Plain names and meanings: for people alone, so that nothing stored depends on them."""

from __future__ import annotations

import dataclasses

import pytest

from sim.tasks import TASKS, get_task
from sim.tasks.fingerprint import fingerprint
from sim.types import Dimension, Space


@pytest.mark.parametrize(
    ("dimension", "title"),
    [
        (Dimension("h", "cm", 1.0, 2.0, plain="piece height"), "piece height h [cm]"),
        (Dimension("k11", "N m/rad", 0.0, 1.0, plain="gain k11"), "gain k11 [N m/rad]"),
        (Dimension("mu", "", 0.0, 1.0, plain="friction"), "friction mu"),
        (Dimension("speed", "m/s", 0.0, 1.0, plain="speed"), "speed [m/s]"),
        (Dimension("mu", "", 0.0, 1.0), "mu"),
    ],
)
def test_a_title_has_plain_name_name_and_unit(dimension: Dimension, title: str) -> None:
    assert dimension.title == title


@pytest.mark.parametrize("name", TASKS)
def test_every_number_has_a_plain_name_and_one_line_of_meaning(name: str) -> None:
    task = get_task(name)
    for space in (task.parameters, task.context, task.action, task.nuisance):
        for dimension in space.dimensions:
            assert dimension.plain, dimension.name
            assert 0 < len(dimension.meaning) <= 100, dimension.name
        assert len({d.plain for d in space.dimensions}) == len(space)


@pytest.mark.parametrize("name", TASKS)
def test_words_change_no_fingerprint_and_no_equality(name: str) -> None:
    task = get_task(name)
    bare = Space(tuple(dataclasses.replace(d, plain="", meaning="") for d in task.parameters.dimensions))
    assert bare == task.parameters
    assert fingerprint(dataclasses.replace(task, parameters=bare)) == fingerprint(task)
