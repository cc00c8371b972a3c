"""What light commands import: one line too much, and every command waits seconds for its first output."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from adaptsim_cli.commands import app
from adaptsim_cli.screen import loading

HEAVY = ("cv2", "dash", "matplotlib", "mujoco", "open3d", "pydrake", "scipy", "torch")
PROGRAM = "import sys; {}; sys.stderr.write(' '.join(m for m in {} if m in sys.modules))"


@pytest.mark.parametrize(
    ("program", "needed"),
    [
        ("from adaptsim_cli.commands.app import run; run(['--help'])", ""),
        ("from adaptsim_cli.commands.app import run; run(['config', 'path'])", ""),
        ("from adaptsim_cli.commands.app import run; run(['lab', 'list'])", ""),
        ("from adaptsim_cli.commands.app import run; run(['sessions', 'list'])", ""),
        ("from adaptsim_cli.commands.app import run; run(['checkpoints', 'list'])", ""),
        ("import sim.tasks, hw.workcell", ""),
        ("import adaptsim_cli.session.store", ""),
        ("import adaptsim_cli.session.opening, adaptsim_cli.session.hindsight", "cv2 scipy"),
        ("from perception.raycasting import load_open3d; load_open3d()", "open3d"),
        ("import sim.tasks.scooping, sim.lab.simulated, adaptsim_cli.session.opening", "cv2 pydrake scipy"),
    ],
)
def test_nothing_heavy_is_imported_that_is_not_needed(program, needed):
    line = [sys.executable, "-c", PROGRAM.format(program, HEAVY)]
    done = subprocess.run(line, check=True, capture_output=True, text=True)
    assert done.stderr == needed


PAUSED = "import atexit, gc, sys; from adaptsim_cli.__main__ import main; sys.argv[1:] = ['config', 'path']; {}; main()"


def test_garbage_is_collected_again_once_a_command_runs():
    told = "atexit.register(lambda: sys.stderr.write(f'{gc.isenabled()} {gc.get_freeze_count() > 10_000}'))"
    line = [sys.executable, "-c", PAUSED.format(told)]
    assert subprocess.run(line, check=True, capture_output=True, text=True).stderr == "True True"


ERASED = "\r\x1b[K"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def stderr_of(monkeypatch: pytest.MonkeyPatch, stderr: io.StringIO, *line: str, term: str = "xterm") -> str:
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr(sys, "stderr", stderr)
    app.run(line)
    return stderr.getvalue()


def test_it_comes_first_and_gives_way_to_what_is_said(monkeypatch):
    assert stderr_of(monkeypatch, Terminal(), "config", "path") == loading.LINE + ERASED
    refused = stderr_of(monkeypatch, Terminal(), "config", "nonsense")
    assert refused.startswith(loading.LINE + ERASED) and "nonsense" in refused


@pytest.mark.parametrize("line", [("--help",), ("config", "-h"), ("--version",)])
def test_it_is_not_shown_where_nothing_is_loaded(line, monkeypatch):
    assert stderr_of(monkeypatch, Terminal(), *line) == ""


def test_no_pipe_and_no_dumb_terminal_holds_it(monkeypatch):
    assert stderr_of(monkeypatch, io.StringIO(), "config", "path") == ""
    assert stderr_of(monkeypatch, Terminal(), "config", "path", term="dumb") == ""


def test_the_program_is_a_module_too():
    line = [sys.executable, "-m", "adaptsim_cli", "--version"]
    done = subprocess.run(line, check=True, capture_output=True, text=True)
    assert done.stdout.startswith("adaptsim 0.")
