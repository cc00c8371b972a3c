"""What an early version stored still opens: sessions, checkpoint, calibration (tests/data/first-formats/SOURCE.md)."""

from __future__ import annotations

import json
import shutil
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adaptsim_cli import app, config
from adaptsim_cli.doctor import lab as doctor
from adaptsim_cli.doctor.finding import Severity
from adaptsim_cli.session import recording
from adaptsim_cli.wiring.calibration import calibration_of, current_calibration

DATA = Path(__file__).parents[1] / "data" / "first-formats"


@pytest.fixture
def old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it all, as the user's own; commands run there."""
    folder = Path(shutil.copytree(DATA, tmp_path / "old"))
    monkeypatch.setenv("ADAPTSIM_HOME", str(folder / "home"))
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.chdir(folder)
    return folder


def read(*path: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(DATA.joinpath("home/data", *path).read_text())
    return found


@pytest.mark.parametrize("name", ["pendulum", "scooping"])
def test_a_session_is_shown_with_the_numbers_that_it_had(
    name: str, old: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["sessions", "show", name, "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    for number, trial in enumerate(shown["trials"], start=1):
        stored = read("sessions", name, "iteration-00", f"trial-{number:03d}-attempt-0", "trial.json")
        assert trial["reward"] == stored["reward"]
        assert trial["outcome"] == stored["track"]["outcome"]
    assert len(shown["trials"]) == 2


def test_sessions_of_the_first_format_are_whole(old: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(["sessions", "verify", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert [session["damage"] for session in found["sessions"]] == [[], []]
    (old / "home/data/sessions/pendulum/iteration-00/trial-001-attempt-0/trial.json").write_text("{}")
    assert app.run(["sessions", "verify", "pendulum"]) != 0


@pytest.mark.parametrize(("name", "drawn"), [("pendulum", "q1 [rad]"), ("scooping", "data:image/jpeg")])
def test_a_session_has_its_report(name: str, drawn: str, old: Path) -> None:
    assert app.run(["report", name]) == 0
    page = (old / "home/data/sessions" / name / "report.html").read_text()
    assert "<svg" in page
    assert drawn in page
    best = read("sessions", name, "iteration-00", "result-0", "summary.json")["best"]
    assert f"{best['mean_reward']:.2f}" in page


def test_a_recording_is_read(old: Path) -> None:
    trial = old / "home/data/sessions/scooping/iteration-00/trial-001-attempt-0"
    found = recording.read(trial / recording.FILE)
    assert len(found.frames) == 2
    assert found.frames[0].depth_mm.any()
    assert found.execution.q_measured_rad.shape == (201, 7)


def test_a_session_goes_on_with_its_checkpoint(
    old: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ADAPTSIM_CHECKPOINT", "checkpoint")
    before = read("sessions", "pendulum", "iteration-00", "result-0", "summary.json")
    asked = ["run-iteration", "--task", "pendulum", "--world", "ood-4", "--session", "pendulum", "--yes", "--json"]
    assert app.run(asked) == 0
    after = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert after["iteration"] == before["iteration"] + 2 == 2, "numbered from 1, whatever the format counts from"
    for was, now in zip(before["particles"], after["particles"], strict=True):
        assert now["params"] == pytest.approx(was["next_params"])


def test_a_checkpoint_is_verified(old: Path, capfd: pytest.CaptureFixture[str]) -> None:
    asked = ["checkpoints", "verify", "checkpoint", "--task", "pendulum", "--rollouts", "12", "--json"]
    assert app.run(asked) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["holds"]
    assert [figure["name"] for figure in found["figures"]] == ["mean reward of adaptsim-belief", "mean reward of udr"]


def test_a_calibration_is_what_a_session_works_with_and_the_doctor_shows(old: Path) -> None:
    stored = read("calibrations", "lab-scooping-ood-1-seed0", "calibration-0001", "calibration.json")
    loaded = config.load({"task": "scooping", "world": "ood-1", "seed": 0})
    eye, offsets_rad = calibration_of(loaded.config, loaded.places, None)
    assert np.array_equal(eye.X_BC, stored["X_AC"])
    assert np.array_equal(offsets_rad, stored["joint_offsets"]["offsets_rad"])
    made = datetime.fromisoformat(stored["created"])
    known = current_calibration(loaded.config, loaded.places)
    fresh, aged = (doctor.calibration(known, 30, made + timedelta(days=days), "fake") for days in (10, 40))
    assert (fresh.verdict, aged.verdict) == (Severity.OK, Severity.ADVICE)
    assert "± 0.0 mm, ± 0.00°, 10 days old" in str(fresh)


def test_a_session_that_counts_from_zero_goes_on_so_on_the_disk_and_from_one_on_the_screen(
    old: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ADAPTSIM_CHECKPOINT", "checkpoint")
    asked = ["run-iteration", "--task", "pendulum", "--world", "ood-4", "--session", "pendulum", "--yes"]
    assert app.run(asked) == 0
    folder = old / "home/data/sessions/pendulum"
    assert (folder / "iteration-01/trial-003-attempt-0/trial.json").is_file()
    assert json.loads((folder / "iteration-01/result-0/result.json").read_text())["iteration"] == 1
    assert "iteration 2 of session pendulum" in capfd.readouterr().out
    assert app.run(["sessions", "show", "pendulum", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    places = [(t["iteration"], t["particle"], t["trial"], t["attempt"]) for t in shown["trials"]]
    assert places == [(1, 1, 1, 1), (1, 2, 2, 1), (2, 1, 3, 1), (2, 2, 4, 1)]
    assert app.run(["sessions", "redo", "pendulum", "4", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["next_attempt"] == 2
    assert app.run(asked) == 0
    assert (folder / "iteration-01/trial-004-attempt-1/trial.json").is_file()
    assert (folder / "iteration-01/result-1/result.json").is_file()
