"""`import adaptsim`: the public face, quick to import."""

from __future__ import annotations

import subprocess
import sys

import pytest

import adaptsim
from adaptsim_cli import api
from adaptsim_cli.errors import UsageError
from sim.errors import TaskError


def test_it_has_sessions_tasks_errors_and_a_version():
    assert adaptsim.begin is api.begin
    assert adaptsim.UsageError is UsageError
    assert adaptsim.TaskError is TaskError
    assert adaptsim.__version__.count(".") >= 1
    assert {*api.__all__, "task", "mjcf", "run_gym", "program", "drake", "TaskError"} <= {*dir(adaptsim)}
    for name in dir(adaptsim):
        assert getattr(adaptsim, name) is not None


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="adaptsim has no 'no_such_thing': there is"):
        adaptsim.no_such_thing  # noqa: B018


def test_a_task_file_is_read_without_torch_or_drake():
    heavy = "[name for name in ('torch', 'pydrake') if name in sys.modules]"
    code = f"import sys, adaptsim; adaptsim.task, adaptsim.run_gym; print({heavy})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
