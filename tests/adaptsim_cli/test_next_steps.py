"""Every command ends with the next one, and what it names can be typed."""

from __future__ import annotations

import re

import pytest
from documents import parse

from adaptsim_cli.commands import app

SESSION = ["run-iteration", "--task", "pendulum", "--world", "wd", "--yes", "--session"]
NAMED = re.compile(r"^(?:Next: |  or: )(.*)$", re.MULTILINE)


def named(capfd: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    """The commands that a command names at its end."""
    capfd.readouterr()
    assert app.run(arguments) == 0
    found = NAMED.findall(capfd.readouterr().out)
    assert found, f"adaptsim {' '.join(arguments)} leaves nobody a next step"
    return found


@pytest.mark.long
def test_from_the_first_trial_to_the_last_command_there_is_a_next_one(capfd):
    for command in (
        [*SESSION, "s"],
        [*SESSION, "other"],
        ["rollout", "--session", "s", "--best", "--yes"],
        ["sessions", "list"],
        ["sessions", "show", "s"],
        ["sessions", "verify", "s"],
        ["sessions", "mark", "s", "--note", "a note"],
        ["sessions", "policy", "s", "--out", "policy.json"],
        ["sessions", "export", "s"],
        ["sessions", "redo", "s", "2"],
        ["sessions", "accept", "s", "2"],
        ["compare", "s", "other"],
        ["report", "s"],
        ["bundle", "s"],
        ["sessions", "prune", "s", "--yes"],
        ["sessions", "delete", "other", "--yes"],
    ):
        for line in named(capfd, *command):
            if line.startswith("adaptsim"):
                parse(line)


def test_so_there_is_without_a_session(capfd):
    for command in (
        ["doctor", "--task", "pendulum"],
        ["lab", "list", "--task", "scooping"],
        ["lab", "show", "--task", "scooping", "--world", "wd"],
        ["checkpoints", "list"],
        ["config", "show"],
        ["config", "path"],
        ["calibrate", "list", "--world", "wd"],
        ["touch-off", "list", "--world", "wd"],
        ["schema"],
    ):
        for line in named(capfd, *command):
            if line.startswith("adaptsim"):
                parse(line)
