"""Every test has a folder and a home of its own; a session of the toy rig is run once and copied."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from toy_session import NAME, run

from adaptsim_cli.session.store import SessionStore


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch) -> Path:
    """The folder that a test works in; its home is `home` below it."""
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory) -> SessionStore:
    """A session of one iteration, to compare with."""
    return run(tmp_path_factory.mktemp("undisturbed"))


@pytest.fixture
def store(undisturbed: SessionStore, place) -> SessionStore:
    """A copy of it in the test's home, to go on with or to spoil."""
    shutil.copytree(undisturbed.folder.parents[1], place / "home/data")
    return SessionStore.open(place / "home/data/sessions", NAME)
