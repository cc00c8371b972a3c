"""Every test has a folder and a home of its own; a session of the toy rig is run once and copied."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from documents import parse
from toy_session import NAME, run

from adaptsim_cli.commands import app
from adaptsim_cli.screen import console
from adaptsim_cli.session.store import SessionStore


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch) -> Path:
    """The folder that a test works in; its home is `home` below it."""
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(autouse=True)
def _every_next_step_can_be_typed(monkeypatch) -> None:
    """Whatever any test makes a command print after "Next:" must be a command with options that it has."""
    shown = console.Screen.next

    def checked(screen: console.Screen, *steps: tuple[str, str]) -> None:
        for command, _ in steps:
            if command.startswith("adaptsim "):
                parse(command)
        shown(screen, *steps)

    monkeypatch.setattr(console.Screen, "next", checked)


@pytest.fixture
def kim(place, monkeypatch) -> None:
    """A person called Kim, at a terminal that is taken for granted."""
    monkeypatch.setenv("ADAPTSIM_OPERATOR", "Kim")
    monkeypatch.setattr(console, "require_terminal", lambda *_: None)


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory) -> SessionStore:
    """A session of one iteration, to compare with."""
    return run(tmp_path_factory.mktemp("undisturbed"))


@pytest.fixture
def store(undisturbed: SessionStore, place) -> SessionStore:
    """A copy of it in the test's home, to go on with or to spoil."""
    shutil.copytree(undisturbed.folder.parents[1], place / "home/data")
    return SessionStore.open(place / "home/data/sessions", NAME)


@pytest.fixture
def refused(capfd):
    """Runs a command that must end with this code; returns its one message, on one line."""

    def run(code: int, *line: str) -> str:
        capfd.readouterr()
        assert app.run(line) == code, line
        _, err = capfd.readouterr()
        assert err.count("Error:") == 1 and "Traceback" not in err, err
        return " ".join(err.split())

    return run


@pytest.fixture
def printed(capfd):
    """Runs a command that must succeed; returns the one JSON value that it prints."""

    def run(*line: str):
        capfd.readouterr()
        assert app.run(line) == 0, line
        return json.loads(capfd.readouterr().out)

    return run
