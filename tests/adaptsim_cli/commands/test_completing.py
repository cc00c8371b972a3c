"""What a shell completes, asked as a shell asks it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from adaptsim_cli.commands import options
from sim.tasks import TASKS

PROGRAM = "import sys; sys.argv = ['adaptsim']; from adaptsim_cli.commands.app import main; main()"


@pytest.fixture
def home(place) -> Path:
    for name in ("sessions/scoop-1", "sessions/push-1", "sessions/.hidden", "rollouts/one"):
        (place.parent / "home/data" / name).mkdir(parents=True)
    return place.parent / "home"


def test_names_of_this_machine_are_completed(home):
    assert options.session_names("") == ["push-1", "scoop-1"]
    assert options.session_names("sc") == ["scoop-1"]
    assert options.task_names("") == sorted(TASKS)
    assert "ood-1" in options.world_names("ood")


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("adaptsim sessions sh", ["show"]),
        ("adaptsim sessions show s", ["scoop-1"]),
        ("adaptsim run-iteration --session p", ["push-1"]),
        ("adaptsim run-iteration --task pen", ["pendulum"]),
        ("adaptsim sessions mark s", ["scoop-1"]),
        ("adaptsim run-iteration --hw fr", ["fr3", "fr3v2"]),
        ("adaptsim run-iteration --method ud", ["udr"]),
        ("adaptsim run-iteration --control s", ["scoop-1", "sysid-bayes", "sysid-bayes-point", "sysid-bayes-state"]),
    ],
)
def test_a_shell_gets_them(home, typed, expected):
    asked = {"_ADAPTSIM_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
    program = [sys.executable, "-c", PROGRAM]
    found = subprocess.run(program, env={**os.environ, **asked}, capture_output=True, text=True, check=False)
    assert found.stdout.split() == expected, found.stderr


def test_only_folders_of_worlds_are_tasks(tmp_path, monkeypatch):
    for file in ("pendulum/wd.toml", "__pycache__/wd.cpython-311.pyc"):
        (tmp_path / file).parent.mkdir()
        (tmp_path / file).write_text("")
    monkeypatch.setattr(options, "_WORLDS", tmp_path)
    monkeypatch.setattr(options, "entry_points", lambda group: ())
    assert options.task_names("") == ["pendulum"]
