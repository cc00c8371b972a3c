"""A task file that raises, exits, forks, sleeps or prints is refused or noted with its line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sim.errors import TaskError, UnknownName
from sim.own.template import template
from sim.own.watching import watched
from sim.rollouts.dataset import draw_requests
from sim.rollouts.executors import process_pool
from sim.rollouts.run import run_many
from sim.tasks import get_task, task_of_file

BODY = template("mine")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))


def written(tmp_path: Path, first: str = "", body: str = BODY, name: str = "mine.py") -> Path:
    path = tmp_path / name
    path.write_text(f"{first}\n{body}")
    return path


@pytest.mark.parametrize(
    ("first", "words"),
    [
        ("x = 1 / 0", "mine.py, line 1: it raises ZeroDivisionError: division by zero"),
        ("import sys; sys.exit(3)", "mine.py, line 1: it exits"),
        ("import os; os._exit(3)", r"mine.py, line 1 calls os._exit: a task may neither end nor double the process"),
        ("import os; os.fork()", r"mine.py, line 1 calls os.fork"),
        ("import time; time.sleep(1000)", "mine.py, line 1 sleeps for 1000 s: every command would wait for it"),
        ("def f(:", "mine.py, line 1: it raises SyntaxError"),
        ("import nothing_of_the_kind", "mine.py, line 1: it raises ModuleNotFoundError"),
    ],
)
def test_a_file_that_does_not_load_is_named_with_its_line(tmp_path, first, words):
    with pytest.raises(TaskError, match=words):
        task_of_file(str(written(tmp_path, first)))


def test_a_wrong_argument_is_named_with_its_line(tmp_path):
    path = written(tmp_path, body=BODY.replace("duration=3.0", "duration=-1"))
    with pytest.raises(TaskError, match=r"mine.py, line \d+: duration = -1: it must be a number"):
        task_of_file(str(path))


def test_what_a_file_prints_leaves_stdout_alone_and_is_noted(tmp_path, capsys):
    body = BODY.replace("    times = np", "    print('rolling')\n    times = np", 1)
    path = written(tmp_path, "print('loading')", body)
    with watched(str(path)) as notes:
        task = task_of_file(str(path))
        task.simulate(task.parameters.middle, task.context.middle, task.action.middle, task.nuisance.middle)
    assert capsys.readouterr().out == ""
    assert notes.lines["prints"][0] == 1
    assert len(notes.lines["prints"]) == 2


@pytest.mark.long  # a fresh process each
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("raise ValueError('too fast')", r"mine.py, line (\d+): it raises ValueError: too fast, with p"),
        ("import sys; sys.exit(3)", r"mine.py, line (\d+): it exits, with p"),
        ("import os; os._exit(3)", r"mine.py, line (\d+) calls os._exit: a task may neither end nor double"),
        ("import os; os.fork()", r"mine.py, line (\d+) calls os.fork"),
    ],
)
def test_a_rollout_of_any_command_that_misbehaves_is_named_with_its_line(tmp_path, line, words):
    body = BODY.replace("    times = np", f"    {line}\n    times = np", 1)
    path = written(tmp_path, body=body)
    task = task_of_file(str(path))
    with process_pool(1) as crew, pytest.raises(TaskError, match=words) as raised:
        run_many(task, draw_requests(task, 2, np.random.default_rng(0)), crew)
    (number,) = re.findall(r"line (\d+)", str(raised.value))
    assert path.read_text().splitlines()[int(number) - 1].strip() == line


def test_a_print_of_any_command_goes_to_stderr_with_its_line(tmp_path, capsys):
    body = BODY.replace("    times = np", "    print('rolling')\n    times = np", 1)
    path = written(tmp_path, body=body)
    task = task_of_file(str(path))
    task.simulate(task.parameters.middle, task.context.middle, task.action.middle, task.nuisance.middle)
    shown = capsys.readouterr()
    number = 1 + path.read_text().splitlines().index("    print('rolling')")
    assert shown.out == ""
    assert shown.err == f"{path}, line {number} prints: rolling\n"


def test_a_file_without_a_task_and_one_with_two_are_refused(tmp_path):
    with pytest.raises(TaskError, match=r"declares no task: put @adaptsim.task"):
        task_of_file(str(written(tmp_path, body="x = 1")))
    second = BODY.replace("def mine(", "def other(").partition("import adaptsim")[2]
    path = written(tmp_path, body=BODY + second, name="two.py")
    with pytest.raises(TaskError, match=r"declares 2 tasks: choose one, as .*two.py:mine"):
        task_of_file(str(path))
    assert task_of_file(f"{path}:other").name == "other"


def test_a_file_that_is_gone_is_said(tmp_path):
    path = written(tmp_path)
    task_of_file(str(path))
    path.unlink()
    with pytest.raises(TaskError, match=r"the task mine was declared by .*mine.py, and there is no such file any more"):
        get_task("mine")
    with pytest.raises(UnknownName, match=r"there is no task file .*mine.py: check the path"):
        task_of_file(str(path))


def test_a_task_may_not_have_the_name_of_one_of_ours(tmp_path):
    path = written(tmp_path, body=BODY.replace("def mine(", "def pushing("))
    with pytest.raises(TaskError, match="declares a task pushing, and there is another one of that name"):
        task_of_file(str(path))


def test_a_file_imports_what_lies_beside_it(tmp_path):
    (tmp_path / "beside_it.py").write_text("MU = (0.1, 0.3)\n")
    body = BODY.replace('"mu": (0.1, 0.3)', '"mu": beside_it.MU')
    assert task_of_file(str(written(tmp_path, "import beside_it", body))).parameters.low[0] == 0.1
