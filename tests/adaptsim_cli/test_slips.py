"""A person who does everything wrong: no slip loses a trial, starts a motion, or begins a session that nobody named."""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from lab_session import ADAPTSIM, environment
from toy_rig import ToyLab, opener

from adaptsim_cli import app
from adaptsim_cli.screen import console
from adaptsim_cli.wiring import session as wiring

CTRL_C = "^C"
GO_ON = ("run-iteration", "--session", "study")
BEGIN = ("run-iteration", "--task", "toy", "--yes")


@dataclass(frozen=True)
class Slip:
    """A command line, what is typed then, and how it ends."""

    line: tuple[str, ...]
    code: int
    typed: tuple[str, ...] = ()
    motions: int = 0  # that the typed answers have agreed to
    env: dict[str, str] = field(default_factory=dict)
    says: str = ""  # on stderr, as a pattern

    def __str__(self) -> str:
        return " ".join((*self.line, "/", *(repr(answer) for answer in self.typed), *self.env.values()))


SLIPS = [
    # wrong names
    Slip(("run-iteraton",), 2, says="No such command 'run-iteraton'"),
    Slip(("rollout", "--yes", "--task", "tyo"), 2, says="task .tyo. is not known: it must be one of"),
    Slip(("run-iteration", "--yes", "--world", "narnia"), 2, says="no world 'narnia'"),
    Slip(("run-iteration", "--yes", "--world", "./missing.toml"), 2, says="no world file"),
    Slip(("run-iteration", "--yes", "--session", "studdy"), 2, says="did you mean study"),
    Slip(("run-iteration", "--yes", "--world", "wd"), 2),
    Slip(("run-iteration", "--yes", "--world", "ligt-bottle"), 2, says="did you mean light-bottle"),
    Slip(("run-iteration", "--yes", "--seed", "4"), 2),
    Slip(("run-iteration", "--yes", "--session", "study", "--method", "adaptsin"), 2),
    Slip(("run-iteration", "--yes", "--session", "study", "--seed", "9"), 2, says="was begun with seed = 0, not 9"),
    Slip(("run-iteration", "--yes", "--session", "study", "--task", "pushing"), 2),
    Slip(("run-iteration", "--yes", "--session", "study", "--hw", "ur5"), 2, says="choose one of fake, panda, fr3"),
    Slip(("report", "studdy"), 8),
    Slip(("rollout", "--session", "nosuch", "--best", "--yes"), 8),
    # wrong numbers
    Slip((*BEGIN, "-n", "0"), 2, says="greater than or equal to 1|not in the range x>=1"),
    Slip((*BEGIN, "--pace", "7"), 2),
    Slip((*BEGIN, "--seed", "-1"), 2, says="seed = -1"),
    Slip((*BEGIN, "--view-port", "80"), 2),
    Slip(("sessions", "redo", "study"), 2, says="Missing argument"),
    Slip(("sessions", "redo", "study", "99"), 2),
    Slip(("sessions", "accept", "study", "1"), 2),
    Slip(BEGIN, 2, env={"ADAPTSIM_SEED": "many"}),
    Slip(BEGIN, 2, env={"ADAPTSIM_HOME": "/dev/null/home"}),
    # no terminal, and the wrong answers at one
    Slip(("run-iteration", "--task", "toy"), 2),
    Slip(("sessions", "delete", "study"), 2),
    Slip(("sessions", "delete", "study"), 7, ("stuyd",)),
    Slip(("sessions", "delete", "study"), 7, ("",)),
    Slip(("sessions", "delete", "study"), 7, ("?",)),
    Slip(("run-iteration", "--task", "toy", "--session", "studdy"), 7, ("",)),
    Slip(("run-iteration", "--task", "toy", "--session", "studdy"), 7, ("?", "yes", "q")),
    Slip(("run-iteration", "--task", "toy", "--session", "studdy"), 130, (CTRL_C,)),
    *(
        Slip(GO_ON, code, (*agreed, *answers), motions)
        for agreed, motions in (((), 0), (("",), 0), (("", ""), 1))
        for code, answers in (
            (130, (CTRL_C,)),
            (7, ()),  # the terminal was closed
            (7, ("?", "yes", "start", "123", "Q")),
        )
    ),
    Slip(GO_ON, 7, ("", "", "r", "?", "q", "q"), 1),
    Slip(GO_ON, 7, ("", "", "o", "9", "?", "q", "q"), 1),
]


class Keyboard(io.StringIO):
    """The answers, then the end of input."""

    def __init__(self, answers: tuple[str, ...]) -> None:
        super().__init__("".join(f"{answer}\n" for answer in answers))

    def readline(self, *size: int) -> str:  # type: ignore[override]
        line = super().readline(*size)
        if line.strip() == CTRL_C:
            raise KeyboardInterrupt
        return line


@pytest.fixture(scope="module")
def before(tmp_path_factory) -> Iterator[Path]:
    """The home of a session with one iteration."""
    home = tmp_path_factory.mktemp("slips") / "home"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ADAPTSIM_HOME", str(home))
        patch.setattr(wiring, "open_parts", opener(ToyLab(0)))
        assert app.run([*BEGIN, "--session", "study"]) == 0
    yield home


def kept(home: Path) -> dict[str, str]:
    """Every trial that counts or once counted, by its content."""
    root = home / "data/sessions"
    return {str(file.relative_to(root)): _sha256(file) for file in root.glob("*/iteration-*/*/trial.json")}


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def begun(home: Path) -> set[str]:
    return {folder.name for folder in (home / "data/sessions").glob("[!.]*")}


@pytest.mark.parametrize("slip", SLIPS, ids=str)
def test_a_slip_costs_nothing(slip, before, tmp_path, monkeypatch, capfd):
    home, lab = tmp_path / "home", ToyLab(0)
    shutil.copytree(before, home)
    for name, value in {"ADAPTSIM_HOME": str(home), **slip.env}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(wiring, "open_parts", opener(lab))
    monkeypatch.setattr("sys.stdin", Keyboard(slip.typed))
    if slip.code in (7, 130):
        monkeypatch.setattr(console, "require_terminal", lambda *_: None)
    assert app.run(slip.line) == slip.code
    told = " ".join(capfd.readouterr().err.split())
    assert "Traceback" not in told
    assert re.search(slip.says, told)
    assert kept(home) == kept(before)
    assert begun(home) == {"study"}
    assert len(lab.executions) == slip.motions
    assert not [folder for folder in tmp_path.iterdir() if folder.name != "home"]


def test_a_trial_done_again_is_not_lost(before, tmp_path, monkeypatch, capfd):
    """Redo after accept, twice, and everything taken back."""
    home = tmp_path / "home"
    shutil.copytree(before, home)
    monkeypatch.setenv("ADAPTSIM_HOME", str(home))
    assert [app.run(["sessions", *line, "study", "4"]) for line in (["redo"], ["redo"], ["accept"])] == [0, 2, 0]
    assert "Traceback" not in capfd.readouterr().err
    assert kept(home) == kept(before)


@pytest.mark.long
def test_a_pipe_that_breaks_and_a_terminal_without_unicode_leave_a_session_that_goes_on(tmp_path):
    command = [*ADAPTSIM, "run-iteration", "--task", "pendulum", "--world", "wd", "--yes"]
    piped: Any = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=environment(tmp_path), **piped) as broken:
        broken.stdout.close()
        assert "Traceback" not in broken.stderr.read()
    assert broken.returncode != 0
    whole = subprocess.run(command, env=environment(tmp_path, PYTHONIOENCODING="ascii"), **piped, check=False)
    assert "Traceback" not in whole.stderr and "Report: " in whole.stdout
    assert begun(tmp_path) == {"pendulum-wd"}
    assert len(kept(tmp_path)) == 2, "none is lost to the pipe"


def test_a_port_in_use_begins_nothing(place, monkeypatch, refused):
    monkeypatch.setattr(wiring, "open_parts", opener(ToyLab(0)))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert "is taken" in refused(2, *BEGIN, "--view-port", str(taken.getsockname()[1]))
    assert begun(place / "home") == set()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_home_without_rights_is_named(place, monkeypatch, refused):
    monkeypatch.setattr(wiring, "open_parts", opener(ToyLab(0)))
    place.chmod(0o500)
    said = refused(8, *BEGIN)
    place.chmod(0o700)
    assert "ADAPTSIM_HOME" in said
