"""The scooping motions on the arm: what the mounting of the spatula was chosen for."""

from itertools import product

import numpy as np
import pytest

from sim.panda.planning import home, trial_paths
from sim.panda.redundancy import ALLOWED
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()


def check(context: tuple[float, ...], action: tuple[float, ...], model: str) -> None:
    cell = cell_as_shipped(HARDWARE, model)
    motion = HARDWARE.plan(np.array(context), np.array(action))
    paths = trial_paths(motion, HARDWARE.X_FT, cell, home(HARDWARE.X_FT, cell))
    reports = [cell.require(path, path.q_rad[0]) for path in paths]
    assert reports[1].joint_ratio <= ALLOWED


LOW, HIGH = np.r_[TASK.context.low, TASK.action.low], np.r_[TASK.context.high, TASK.action.high]


@pytest.mark.parametrize("corner", [(0, 1, 1, 1, 1), (1, 0, 1, 1, 0), (1, 1, 0, 0, 0)])
def test_extreme_scoops_are_executable(corner: tuple[int, ...]) -> None:
    value = np.choose(corner, (LOW, HIGH))
    check(tuple(value[:2]), tuple(value[2:]), "panda")


@pytest.mark.slow
def test_every_corner_is_executable_on_the_panda() -> None:
    for value in product(*zip(LOW, HIGH, strict=True)):
        check(value[:2], value[2:], "panda")
