"""The program as it is called: exit codes, messages, streams. Every bad input: one clear message, nothing lost."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from toy_rig import ToyLab, opener
from toy_session import NAME, run

from adaptsim_cli.commands import app
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import opening
from adaptsim_cli.storage.durable import seal_toml
from perception.errors import TrackingFailed
from sim.errors import NotExecutable

RUN = ["run-iteration", "--task", "toy", "--yes"]


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> ToyLab:
    """The toy rig in place of the real parts."""
    lab = ToyLab(0)
    monkeypatch.setattr(opening, "open_parts", opener(lab))
    return lab


def told(capfd: pytest.CaptureFixture[str]) -> str:
    """stderr in one line; asserts that it is one message without a traceback, and no error where a person ended it."""
    out, err = capfd.readouterr()
    assert "Traceback" not in err + out
    if "Interrupted" in err:
        assert "Error:" not in err
        return " ".join(err[err.index("Interrupted") :].split())
    assert err.count("Error:") == 1
    return " ".join(err[err.index("Error:") :].split())


def test_a_corrupt_or_foreign_checkpoint_ends_with_8(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (place / "ckpt").mkdir()
    (place / "ckpt" / "card.toml").write_text("not a card [")
    assert app.run(["checkpoints", "verify", "ckpt", "--task", "scooping"]) == 8
    assert "ckpt/card.toml is not valid TOML" in told(capfd)
    card = 'format = 1\ntask = "pushing"\nfingerprint = "x"\nsha256 = "x"\n[interface]\n'
    (place / "ckpt" / "card.toml").write_text(card)
    assert app.run(["checkpoints", "verify", "ckpt", "--task", "scooping"]) == 8
    assert "is for pushing, not for scooping" in told(capfd)
    assert app.run(["checkpoints", "verify", "nowhere", "--task", "scooping"]) == 8
    assert "no checkpoint 'nowhere' for scooping (shipped: blunt-edge, default): make one" in told(capfd)


def test_without_a_terminal_and_without_yes_nothing_begins(
    lab: ToyLab, place: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        assert app.run(["run-iteration", "--task", "toy"]) == 2
        assert "add --yes" in told(capfd)
        assert app.run(["run-iteration", "--task", "toy", "--hw", "panda", "--yes"]) == 2
    assert not (place / "home").exists()


def test_only_a_named_task_begins_a_session(lab: ToyLab, place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sessions = place / "home" / "data" / "sessions"
    for arguments in ([], ["--session", "nosuch"], ["--world", "wd"], ["--seed", "4"], ["--method", "udr"]):
        assert app.run(["run-iteration", "--yes", *arguments]) == 2
        assert "--task" in told(capfd)
        assert not sessions.exists()
    assert app.run([*RUN, "--session", "mine"]) == app.run(RUN) == 0
    assert app.run(["run-iteration", "--session", "mien", "--yes"]) == 2
    assert "did you mean mine?" in told(capfd)
    assert app.run(["run-iteration", "--yes"]) == 0  # the newest one goes on
    begun = {folder.name: len(list(folder.glob("iteration-*"))) for folder in sessions.glob("[!.]*")}
    assert begun == {"mine": 1, NAME: 2}


def test_json_on_stdout_is_one_line_an_iteration_and_nothing_else(
    lab: ToyLab, capfd: pytest.CaptureFixture[str]
) -> None:
    assert app.run([*RUN, "--json", "--iterations", "2"]) == 0
    out, err = capfd.readouterr()
    assert [json.loads(line)["iteration"] for line in out.splitlines()] == [1, 2]
    assert "SIMULATED" in err
    assert "Report:" in err


def test_without_json_a_person_reads_stdout(lab: ToyLab, capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(RUN) == 0
    out, err = capfd.readouterr()
    assert "What changed" in out
    assert err == ""
    assert "\x1b" not in out, "no colours in a pipe"


@pytest.mark.parametrize(
    ("moment", "error", "code"),
    [
        ("stop_recording", TrackingFailed("in none of the frames"), 6),
        ("place", NotExecutable("joint 4 would need 3 rad/s"), 4),
        ("execute", KeyboardInterrupt(), 130),
    ],
)
def test_what_goes_wrong_in_a_trial_has_its_code_and_says_how_to_continue(
    moment: str, error: BaseException, code: int, lab: ToyLab, place: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(trial: int, attempt: int) -> None:
        if trial == 2 and (attempt == 0 or isinstance(error, TrackingFailed)):
            raise error

    lab.hooks[moment] = fail
    assert app.run(RUN) == code
    message = told(capfd)
    assert str(error) in message
    assert f"adaptsim run-iteration --session {NAME}" in message
    lab.hooks.clear()
    assert app.run(["run-iteration", "--session", NAME, "--yes"]) == 0
    assert (place / "home/data/sessions" / NAME / "iteration-01" / "result-1").is_dir()


@pytest.fixture
def interruptible() -> Iterator[None]:
    """As in a terminal, also where the tests themselves run in the background, which ignores interrupts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_control_c_stops_cleanly(lab: ToyLab, capfd: pytest.CaptureFixture[str]) -> None:
    def interrupt(trial: int, _: int) -> None:
        if trial == 2:
            os.kill(os.getpid(), signal.SIGINT)

    lab.hooks["stop_recording"] = interrupt
    assert app.run(RUN) == 130
    assert "Interrupted; everything completed is stored" in told(capfd)
    lab.hooks.clear()
    assert app.run(["sessions", "show", NAME, "--json"]) == 0
    assert [t["trial"] for t in json.loads(capfd.readouterr().out)["trials"]] == [1]


def test_too_little_space_is_seen_before_anything_moves(
    lab: ToyLab, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADAPTSIM_MIN_FREE_MB", str(10**12))
    assert app.run(RUN) == 3
    assert "disk:" in told(capfd)
    assert lab.executions == []


def test_an_arm_with_a_fault_is_seen_before_anything_moves(lab: ToyLab, capfd: pytest.CaptureFixture[str]) -> None:
    lab.fault = "reflex"
    assert app.run(RUN) == 3
    assert "reflex" in told(capfd)
    assert lab.executions == []


def test_a_truncated_session_ends_with_8_naming_the_file(lab: ToyLab, capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(RUN) == 0
    capfd.readouterr()
    file = next(Path.cwd().glob("home/data/sessions/*/iteration-01/trial-002-attempt-1/trial.json"))
    file.write_bytes(file.read_bytes()[:100])
    for command in (["sessions", "show", NAME], ["report", NAME], ["sessions", "verify"], RUN):
        assert app.run(command) == 8, command
        assert "trial-002-attempt-1/trial.json is corrupt" in told(capfd)
    assert app.run(["sessions", "list", "--json"]) == 0, "a damaged session hides no other"
    (listed,) = json.loads(capfd.readouterr().out)["sessions"]
    assert "trial-002-attempt-1/trial.json is corrupt" in listed["error"]


def test_debug_adds_the_traceback(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_DEBUG", "")
    assert app.run(["--debug", "sessions", "show", "none"]) == 8
    assert "Traceback" in capfd.readouterr().err
    monkeypatch.delenv("ADAPTSIM_DEBUG")


def test_a_session_of_another_checkpoint_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = run(tmp_path)
    path = store.folder / "session.toml"
    body, _, _ = path.read_bytes().rpartition(b"# sha256 ")
    path.write_bytes(seal_toml(body.replace(b"c" * 64, b"d" * 64)))
    with pytest.raises(UsageError, match="the checkpoint has changed since session"):
        run(tmp_path)


def test_a_wrong_line_is_answered_with_the_commands_example(capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(["calibrate", "show"]) == 2
    assert "Missing argument 'name'.\nExample: adaptsim calibrate show 1" in capfd.readouterr().err


def test_a_group_without_a_command_shows_its_help_and_no_error(capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(["sessions"]) == 2
    shown = capfd.readouterr()
    assert "Usage: adaptsim sessions" in shown.out + shown.err
    assert "Error" not in shown.err


@pytest.mark.parametrize("columns", ["0", "", "wide", "00"])
def test_a_terminal_that_states_no_width_still_shows_everything(columns, monkeypatch, capfd):
    monkeypatch.setenv("COLUMNS", columns)
    assert app.run(["lab", "list", "--task", "pendulum"]) == 0
    assert "ood-1" in capfd.readouterr().out
