"""Every file that a person may write or receive: whatever it holds, there is one error that names it."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptsim_cli import config
from adaptsim_cli.bench.rig_file import reading
from adaptsim_cli.errors import CliError
from adaptsim_cli.session.store import SessionStore
from calib.errors import CalibrationError
from calib.records import SetupRecord, read
from sim.adaptation.card import CARD, read_card
from sim.errors import SimError
from sim.lab.world import load_world
from sim.tasks import get_task
from sim.tasks.own_object import load_object

TOML = {
    "deep arrays": b"a = " + b"[" * 100_000,
    "deep tables": b"a = " + b"{b = " * 50_000,
    "long key": b"a" + b".a" * 200_000 + b" = 1",
    "digits": b"seed = " + b"9" * 5000,
    "many bits": b"seed = " + b"9" * 40,
    "infinite": b"mu = inf",
    "not a number": b"mu = nan",
    "latin": b'task = "\xe4"',
    "zeros": b"\0" * 1000,
    "twice": b"task = 1\ntask = 2",
    "utf-16": "task = 1".encode("utf-16"),
    "large": b"#" * 5_000_000,
    "empty": b"",
    "unknown key": b"nonsense = 1",
    "of another kind": b'task = [1]\nparams = "x"\nranges = 3\nformat = "a"\narm = 1\nseed = {}',
    "emoji": "\U0001f9be = 1".encode(),
    "long text": b'task = "' + b"x" * 100_000 + b'"',
    "html": b"<!doctype html><title>Sign in</title>",
    "cut short": b'task = "scooping"\n[params',
    "date": b"seed = 1979-05-27T07:32:00Z",
}


def world(path: Path) -> object:
    return load_world(str(path), get_task("scooping"))


def session(path: Path) -> object:
    folder = path.parent / "sessions" / "one"
    folder.mkdir(parents=True)
    path.rename(folder / "session.toml")
    return SessionStore.open(folder.parent, "one")


def card(path: Path) -> object:
    path.rename(path.with_name(CARD))
    return read_card(path.parent, "scooping")


def settings(path: Path) -> object:
    path.rename(path.with_name("adaptsim.toml"))
    return config.load({}, {}, path.parent)


def setup(path: Path) -> object:
    return read(SetupRecord, path)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", TOML)
@pytest.mark.parametrize("load", [world, load_object, reading.read, settings, session, card, setup])
def test_a_hostile_file_ends_in_an_error_that_names_it(tmp_path, load, name):
    path = tmp_path / "hostile.toml"
    path.write_bytes(TOML[name])
    if load is settings and name in ("empty", "long text"):  # no task is looked up here
        load(path)
        return
    with pytest.raises((CliError, SimError, CalibrationError)) as caught:
        load(path)
    assert str(tmp_path) in str(caught.value)
    assert len(str(caught.value)) < 2000, "a message that a person can read"
