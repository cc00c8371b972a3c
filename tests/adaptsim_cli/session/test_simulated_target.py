"""A whole session without arm, camera or bench: the pendulum, with the shipped checkpoint."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from campaigns import campaign
from toy_session import summary

from adaptsim_cli import config
from adaptsim_cli.commands import app
from adaptsim_cli.session import opening
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from sim.tasks.pendulum.solver import rewards

NAME = "pendulum-ood-1"
RUN = ["run-iteration", "--task", "pendulum", "--world", "ood-1", "--yes"]
TRUTH = np.array([1.8, 0.3, 1.5, 1.5])


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def opened() -> SessionStore:
    return SessionStore.open(Path("home/data/sessions").absolute(), NAME)


@pytest.mark.long
def test_two_iterations_end_in_json_and_a_report_with_curves(capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run([*RUN, "--json", "-n", "2"]) == 0
    first, second = (json.loads(line) for line in capfd.readouterr().out.splitlines())
    assert [first["iteration"], second["iteration"]] == [1, 2]
    assert [len(p["trials"]) for p in first["particles"]] == [1, 1]
    assert [p["next_params"] for p in first["particles"]] == [p["params"] for p in second["particles"]]
    for particle in first["particles"]:
        (trial,) = particle["trials"]
        assert trial["context"] == {}
        assert len(trial["observation"]) == 24
        true = rewards(TRUTH, np.array(list(trial["action"].values())))
        assert trial["reward"] == pytest.approx(float(true), abs=1e-9), "the target is the world that was asked for"
    html = page.render(opened())
    assert "Over time" in html
    assert "On the table" not in html
    assert "<img src" not in html
    assert "calibration" not in html
    kept = opened().folder.glob("iteration-01/trial-001-attempt-1/*")
    assert sorted(path.name for path in kept) == ["motion.json", "trajectory.json", "trial.json"]


@pytest.mark.long
def test_until_done_stops_where_another_iteration_is_not_worth_its_trials(capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run([*RUN, "--json", "--until-done"]) == 0
    *before, last = (json.loads(line)["outlook"] for line in capfd.readouterr().out.splitlines())
    assert last["done"]
    assert not any(outlook["done"] for outlook in before)
    assert len(before) == 1, "two iterations are enough"
    assert app.run([*RUN, "-n", "3"]) == 0, "it goes on, as told"
    assert capfd.readouterr().err.count("--until-done") == 0, "the verdict before it said stop already"


@pytest.mark.long
def test_an_interrupted_session_goes_on_to_the_same_end(
    place: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = SessionStore.save_trial

    def cut(self: SessionStore, record: object, files: object) -> None:
        if record.trial == 2:  # type: ignore[attr-defined]
            raise KeyboardInterrupt
        real(self, record, files)  # type: ignore[arg-type]

    monkeypatch.setattr(SessionStore, "save_trial", cut)
    assert app.run(RUN) == 130
    monkeypatch.setattr(SessionStore, "save_trial", real)
    assert app.run(RUN) == 0
    resumed = summary(opened(), 0)
    monkeypatch.setenv("ADAPTSIM_HOME", str(place / "whole"))
    assert app.run(RUN) == 0
    whole = summary(SessionStore.open(config.load().places.sessions, NAME), 0)
    assert resumed["particles"] == whole["particles"]
    assert resumed["best"] == whole["best"]


def test_hardware_is_refused_with_what_to_do(capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run([*RUN, "--hw", "panda"]) == 2
    message = " ".join(capfd.readouterr().err.split())
    assert "the task pendulum runs in simulation only" in message
    assert "Leave --hw out" in message


def test_only_its_own_parts_are_opened(tmp_path: Path) -> None:
    with opening.open_parts(config.load({"task": "pendulum", "world": "wd"}).config, tmp_path) as parts:
        assert [check.name for check in parts.target.checks()] == ["devices"]
        assert parts.provenance.calibration == ""
        assert not (parts.target.moves or parts.target.needs_consent)


@pytest.mark.parametrize("method", campaign(["learn-in-target", "bo", "sysid-bayes-point", "bo-prior"], 2))
def test_a_session_of_a_baseline_runs_and_another_process_continues_it(
    method: str, capfd: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):  # nothing is kept but the session's folder
        assert app.run(["run-iteration", "--task", "pendulum", "--method", method, "--yes", "--json"]) == 0
    first, second = (json.loads(line) for line in capfd.readouterr().out.splitlines())
    assert (first["iteration"], second["iteration"]) == (1, 2)
    assert [p["params"] for p in second["particles"]] == [p["next_params"] for p in first["particles"]]
    assert all(0.0 <= t["reward"] <= 1.0 for p in second["particles"] for t in p["trials"])
