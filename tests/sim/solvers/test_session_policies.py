"""A session trains a policy of its own within a limit, and its solver grows by it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from sim.errors import TaskError
from sim.solvers.library import grown, library_solver, name_for, train_library, trained_within, with_library
from sim.solvers.solver import policy_for
from sim.tasks import task_of_file
from sim.tasks.task import Task

FILE = '''
import time
import adaptsim
import numpy as np


def train(samples, seed):
    mu = np.mean([p.mu for p in samples])
    if mu > 1.7:
        time.sleep(600)
    if mu < 0.75:
        raise ValueError("no friction")
    return np.array([mu])


@adaptsim.task(
    parameters={"mu": (0.8, 1.6)}, state={"x": (0.0, 3.0, "m")}, duration=1.0,
    reward=lambda end: 1 - abs(end.x - 1.0) / 0.5, train=train, policies=3, train_in_session=True, time_limit_s=60,
)
def gains(p, policy):
    """Stop at 1 m."""
    return [0.0, 1.0], [[0.0], [policy[0] / p.mu]]
'''


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Task:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    (tmp_path / "gains.py").write_text(FILE)
    return task_of_file(str(tmp_path / "gains.py"))


@pytest.mark.long
def test_a_policy_is_trained_within_its_limit_and_the_solver_grows(task: Task, tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as crew:
        solver = library_solver(with_library(task, train_library(task, tmp_path, 0, crew, lambda *at: None)))
        place, seconds = np.array([1.57]), list[float]()
        member = trained_within(task, place, tmp_path / "s" / name_for(place), 60.0, seconds.append)
        assert member is not None
        more = grown(solver, [member], tmp_path / "s", crew, lambda *at: None)
        assert (tmp_path / "s" / f"{member.name}.npz").exists()
    assert len(more.listed) == 4
    assert policy_for(more, place[None])(np.zeros(0)).tolist() == [1.57]
    assert trained_within(task, place, tmp_path / "s" / name_for(place), 0.0, seconds.append).sha256 == member.sha256


@pytest.mark.long
def test_a_training_beyond_its_limit_is_stopped_once_and_one_that_fails_says_so(task: Task, tmp_path: Path) -> None:
    slow, wrong = np.array([1.8]), np.array([0.6])
    folder = tmp_path / name_for(slow)
    wide = task.__class__(**{**vars(task), "parameters": task.margin})
    assert trained_within(wide, slow, folder, 3.0, lambda s: None) is None
    assert trained_within(wide, slow, folder, 3.0, lambda s: pytest.fail("begun again")) is None
    with pytest.raises(TaskError, match="no friction"):
        trained_within(wide, wrong, tmp_path / name_for(wrong), 60.0, lambda s: None)
