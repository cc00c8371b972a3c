"""The program as it is called: exit codes, messages, streams. Every bad input: one clear message, nothing lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from toy_rig import ToyLab, opener
from toy_session import NAME

from adaptsim_cli import app
from adaptsim_cli.wiring import session as wiring

RUN = ["run-iteration", "--task", "toy", "--yes"]


@pytest.fixture
def lab(monkeypatch) -> ToyLab:
    """The toy rig in place of the real parts."""
    lab = ToyLab(0)
    monkeypatch.setattr(wiring, "open_parts", opener(lab))
    return lab


def test_a_corrupt_or_foreign_checkpoint_ends_with_8(place, refused):
    (place / "ckpt").mkdir()
    (place / "ckpt" / "card.toml").write_text("not a card [")
    assert "ckpt/card.toml is not valid TOML" in refused(8, "checkpoints", "verify", "ckpt", "--task", "scooping")
    card = 'format = 1\ntask = "pushing"\nfingerprint = "x"\nsha256 = "x"\n[interface]\n'
    (place / "ckpt" / "card.toml").write_text(card)
    assert "is for pushing, not for scooping" in refused(8, "checkpoints", "verify", "ckpt", "--task", "scooping")
    assert "no checkpoint 'nowhere'" in refused(8, "checkpoints", "verify", "nowhere", "--task", "scooping")


def test_only_a_named_task_begins_a_session(lab, place, refused):
    sessions = place / "home" / "data" / "sessions"
    for arguments in ([], ["--session", "nosuch"], ["--method", "udr"]):
        assert "--task" in refused(2, "run-iteration", "--yes", *arguments)
        assert not sessions.exists()
    assert app.run([*RUN, "--session", "mine"]) == app.run(RUN) == 0
    assert app.run(["run-iteration", "--yes"]) == 0  # the newest one goes on
    begun = {folder.name: len(list(folder.glob("iteration-*"))) for folder in sessions.glob("[!.]*")}
    assert begun == {"mine": 1, NAME: 2}


def test_without_json_a_person_reads_stdout(lab, capfd):
    assert app.run(RUN) == 0
    out, err = capfd.readouterr()
    assert "What changed" in out
    assert err == ""
    assert "\x1b" not in out, "no colours in a pipe"


def test_too_little_space_is_seen_before_anything_moves(lab, monkeypatch, refused):
    monkeypatch.setenv("ADAPTSIM_MIN_FREE_MB", str(10**12))
    assert "disk:" in refused(3, *RUN)
    assert lab.executions == []


def test_an_arm_with_a_fault_is_seen_before_anything_moves(lab, refused):
    lab.fault = "reflex"
    assert "reflex" in refused(3, *RUN)
    assert lab.executions == []


def test_a_truncated_session_ends_with_8_naming_the_file(lab, store, refused, printed):
    file = store.folder / "iteration-01/trial-002-attempt-1/trial.json"
    file.write_bytes(file.read_bytes()[:100])
    for command in (["sessions", "show", NAME], ["report", NAME], ["sessions", "verify"], RUN):
        assert "trial-002-attempt-1/trial.json is corrupt" in refused(8, *command)
    (listed,) = printed("sessions", "list", "--json")["sessions"]
    assert "trial-002-attempt-1/trial.json is corrupt" in listed["error"]


def test_debug_adds_the_traceback(capfd, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_DEBUG", "")
    assert app.run(["--debug", "sessions", "show", "none"]) == 8
    assert "Traceback" in capfd.readouterr().err
    monkeypatch.delenv("ADAPTSIM_DEBUG")


def test_another_package_of_the_same_name_is_named_at_the_start(tmp_path):
    for name in ("sim", "calib"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("")
    own = str(Path(app.__file__).parents[1])
    program = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {own!r}]; from adaptsim_cli.app import main; main()"
    found = subprocess.run([sys.executable, "-c", program, "--version"], capture_output=True, text=True, check=False)
    assert found.returncode == 2
    assert f"'sim' is another one, in {tmp_path / 'sim'}" in found.stderr
    assert app.foreign_packages() == ""


def test_a_wrong_line_is_answered_with_the_commands_example(capfd):
    assert app.run(["calibrate", "show"]) == 2
    assert "Missing argument 'name'.\nExample: adaptsim calibrate show 1" in capfd.readouterr().err


def test_a_group_without_a_command_shows_its_help_and_no_error(capfd):
    assert app.run(["sessions"]) == 2
    shown = capfd.readouterr()
    assert "Usage: adaptsim sessions" in shown.out + shown.err
    assert "Error" not in shown.err
