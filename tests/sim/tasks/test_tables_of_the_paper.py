"""Tables A1 and A2 of the paper's appendix (arXiv 2302.04903) are the program's own numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from sim.lab.world import load_world
from sim.tasks import get_task

TABLE_A1 = {  # I, step size, discount, threshold
    "pendulum": (10, 0.10, 0.9, 0.95),
    "pushing": (8, 0.15, 0.9, 0.8),
    "scooping": (8, 0.15, 0.9, 0.5),
}
REUSE = {"pushing": (0.16, 10_000, 30_000, 0.9), "scooping": (0.16, 1_200, 4_000, 0.9)}  # D, M, M_max, alpha

TABLE_A2: Mapping[str, Mapping[str, tuple[Any, ...]]] = {  # parameter: the range, then WD and OOD-1 to OOD-4
    "pendulum": {
        "m1": ((1, 2), 1.8, 1.8, 0.5, 1.2, 0.4),
        "m2": ((1, 2), 1.2, 0.3, 1.8, 1.8, 2.6),
        "b1": ((1, 2), 1.5, 1.5, 1.5, 10.0, 1.0),
        "b2": ((1, 2), 1.5, 1.5, 1.5, 10.0, 2.0),
    },
    "pushing": {
        "mu": ((0.05, 0.2), 0.1, 0.25, 0.05, 0.15, 0.30),
        "e": ((1e4, 1e6), 1e5, 5e4, 1e5, 5e6, 1e5),
        "mu_p": ((0.2, 0.8), 0.6, 0.1, 0.9, 0.1, 0.15),
        "y_p": ((-0.1, 0.1), 0.05, -0.1, 0.05, -0.15, 0.1),
    },
    "scooping": {
        "mu": ((0.25, 0.4), 0.30, 0.45, 0.20, 0.30, 0.40),
        "e": ((1e4, 5e5), 5e4, 1e4, 5e4, 1e6, 1e5),
        "g": ((0, 1), 1, 0, 1, 0, 2),
        "h": ((1.5, 2.5), 2.0, 1.4, 2.2, 2.8, 1.9),
    },
}
WORLDS = ("wd", "ood-1", "ood-2", "ood-3", "ood-4")


@pytest.mark.parametrize("name", TABLE_A1)
def test_the_adaptation_has_the_numbers_of_table_a1(name):
    task = get_task(name)
    own = task.adaptation
    assert (own.horizon, own.delta, own.discount, own.threshold) == TABLE_A1[name]
    if name in REUSE:
        rules = task.reuse
        assert (rules.distance, rules.first_budget, rules.max_budget, rules.discount) == REUSE[name]


@pytest.mark.parametrize("name", TABLE_A2)
def test_ranges_and_targets_are_those_of_table_a2(name):
    task = get_task(name)
    for parameter, (ends, *targets) in TABLE_A2[name].items():
        column = task.parameters.names.index(parameter)
        assert (task.parameters.low[column], task.parameters.high[column]) == pytest.approx(ends)
        for world, value in zip(WORLDS, targets, strict=True):
            assert load_world(world, task).parameters[column] == pytest.approx(value)
