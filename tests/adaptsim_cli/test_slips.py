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

import pytest
from lab_session import ADAPTSIM, environment
from toy_rig import ToyLab, opener

from adaptsim_cli.commands import app
from adaptsim_cli.screen import console
from adaptsim_cli.session import opening

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
    Slip(("run-iteration", "--sped", "3"), 2, says="No such option: --sped"),
    Slip(("rollout", "--yes", "--task", "tyo"), 2, says="task .tyo. is not known: it must be one of"),
    Slip(("run-iteration", "--yes", "--world", "narnia"), 2, says="no world 'narnia'"),
    Slip(("run-iteration", "--yes", "--world", "./missing.toml"), 2, says="no world file"),
    Slip(("run-iteration", "--yes", "--session", "studdy"), 2, says="did you mean study"),
    Slip(("run-iteration", "--yes", "--session", "Study"), 2),
    Slip(("run-iteration", "--yes", "--session", "../study"), 2, says="session name '../study'"),
    Slip(("run-iteration", "--yes", "--world", "wd"), 2),
    Slip(("run-iteration", "--yes", "--world", "ligt-bottle"), 2, says="did you mean light-bottle"),
    Slip(("run-iteration", "--yes", "--seed", "4"), 2),
    Slip(("run-iteration", "--yes", "--session", "study", "--method", "adaptsin"), 2),
    Slip(("run-iteration", "--yes", "--session", "study", "--seed", "9"), 2, says="was begun with seed = 0, not 9"),
    Slip(("run-iteration", "--yes", "--session", "study", "--task", "pushing"), 2),
    Slip(("run-iteration", "--yes", "--session", "study", "--hw", "ur5"), 2, says="choose one of fake, panda, fr3"),
    Slip(("report", "studdy"), 8),
    Slip(("compare", "study", "nosuch"), 8),
    Slip(("rollout", "--session", "nosuch", "--best", "--yes"), 8),
    Slip(("sessions", "redo", "studdy", "1"), 8),
    # wrong numbers
    Slip((*BEGIN, "-n", "0"), 2, says="greater than or equal to 1|not in the range x>=1"),
    Slip((*BEGIN, "-n", "two"), 2),
    Slip((*BEGIN, "--pace", "7"), 2),
    Slip((*BEGIN, "--seed", "-1"), 2, says="seed = -1"),
    Slip((*BEGIN, "--view-port", "80"), 2),
    Slip(("sessions", "redo", "study"), 2, says="Missing argument"),
    Slip(("sessions", "redo", "study", "0"), 2),
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
    Slip(("run-iteration", "--task", "toy", "--session", "studdy"), 7, ("?", "maybe", "q")),
    Slip(("run-iteration", "--task", "toy", "--session", "studdy"), 130, (CTRL_C,)),
    *(
        Slip(GO_ON, code, (*agreed, *answers), motions)
        for agreed, motions in (((), 0), (("",), 0), (("", ""), 0), (("", "y"), 1))
        for code, answers in (
            (7, ("q",)),
            (7, ("Q",)),
            (130, (CTRL_C,)),
            (7, ()),  # the terminal was closed
            (7, ("?", "yes", "start", "123", "q")),
        )
    ),
    Slip(GO_ON, 7, ("", "y", "r", "?", "q", "q"), 1),
    Slip(GO_ON, 7, ("", "y", "o", "9", "?", "q", "q"), 1),
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
def before(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The home of a session with one iteration."""
    home = tmp_path_factory.mktemp("slips") / "home"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ADAPTSIM_HOME", str(home))
        patch.setattr(opening, "open_parts", opener(ToyLab(0)))
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
def test_a_slip_costs_nothing(
    slip: Slip, before: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    home, lab = tmp_path / "home", ToyLab(0)
    shutil.copytree(before, home)
    for name, value in {"ADAPTSIM_HOME": str(home), **slip.env}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(opening, "open_parts", opener(lab))
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
    assert {folder.name for folder in tmp_path.iterdir()} <= {"home", "here"}
    assert not list((tmp_path / "here").iterdir())


def test_a_trial_done_again_is_not_lost(
    before: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Redo after accept, twice, and everything taken back."""
    home = tmp_path / "home"
    shutil.copytree(before, home)
    monkeypatch.setenv("ADAPTSIM_HOME", str(home))
    assert [app.run(["sessions", *line, "study", "4"]) for line in (["redo"], ["redo"], ["accept"])] == [0, 2, 0]
    assert "Traceback" not in capfd.readouterr().err
    assert kept(home) == kept(before)


def run(home: Path, *line: str, **env: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*ADAPTSIM, *line],
        env=environment(home, **env),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding=env.get("PYTHONIOENCODING", "utf-8"),
    )


PENDULUM = ("run-iteration", "--task", "pendulum", "--world", "wd", "--yes")


@pytest.mark.long
def test_a_pipe_without_a_reader_and_a_terminal_without_unicode_lose_no_trial(tmp_path: Path) -> None:
    with run(tmp_path, *PENDULUM) as broken:
        assert broken.stdout is not None and broken.stderr is not None
        broken.stdout.close()
        assert "Traceback" not in broken.stderr.read()
    assert broken.returncode == 0, "the work goes on when nobody reads its lines"
    for encoding in ("latin-1", "ascii"):
        out, err = run(tmp_path, *PENDULUM, PYTHONIOENCODING=encoding).communicate()
        assert "Traceback" not in err and "Report: " in out
    assert begun(tmp_path) == {"pendulum-wd"}
    assert len(kept(tmp_path)) == 6, "three iterations of two trials, none lost to the pipe"


@pytest.mark.long
def test_a_port_in_use_begins_nothing(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        process = run(tmp_path, *PENDULUM, "--view-port", str(taken.getsockname()[1]))
        _, err = process.communicate()
    assert (process.returncode, begun(tmp_path)) == (2, set())
    assert "is taken" in err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_home_without_rights_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    process = run(tmp_path / "home", *PENDULUM)
    _, err = process.communicate()
    tmp_path.chmod(0o700)
    assert process.returncode == 8
    assert "ADAPTSIM_HOME" in err and "Traceback" not in err
