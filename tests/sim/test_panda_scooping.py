"""The scooping motions on the arm: what the mounting of the spatula was chosen for."""

from itertools import product

import numpy as np
import pytest

from hw.limits import require
from sim.panda.planning import home, trial_paths
from sim.panda.redundancy import ALLOWED
from sim.panda.tool import held
from sim.tasks import get_task

TASK = get_task("scooping")


def check(context: tuple[float, ...], action: tuple[float, ...], model: str) -> None:
    assert TASK.plan is not None
    tool = held(TASK.X_FT)
    motion = TASK.plan(np.array(context), np.array(action))
    paths = trial_paths(motion, TASK.X_FT, model, home(TASK.X_FT, model), tool=tool)
    reports = [require(path, model, path.q_rad[0], tool=tool) for path in paths]
    assert reports[1].joint_ratio <= ALLOWED


@pytest.mark.parametrize("corner", [(0, 1, 1, 0, 1), (1, 0, 1, 1, 0), (1, 1, 0, 1, 0)])
def test_extreme_scoops_are_executable(corner: tuple[int, ...]) -> None:
    low, high = np.r_[TASK.context.low, TASK.action.low], np.r_[TASK.context.high, TASK.action.high]
    value = np.where(corner, high, low)
    check(tuple(value[:2]), tuple(value[2:]), "panda")


@pytest.mark.slow
def test_every_corner_of_contexts_and_actions_is_executable() -> None:
    low, high = np.r_[TASK.context.low, TASK.action.low], np.r_[TASK.context.high, TASK.action.high]
    for value in product(*zip(low, high, strict=True)):
        check(value[:2], value[2:], "panda")
