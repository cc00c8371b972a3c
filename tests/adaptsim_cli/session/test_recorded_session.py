"""Sessions whose reality are recorded trials, by the program: begun, stopped, continued, judged by held-out trials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recordings import write_mcap, write_tables

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.session.recorded.folder import read_recorded
from sim.tasks.pendulum import TASK

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    return write_tables(tmp_path_factory.mktemp("lab") / "swings", 32)


def line(recorded: Path, *more: str) -> list[str]:
    return ["run-iteration", "--task", "pendulum", "--recorded", str(recorded), "--yes", *more]


def test_a_session_takes_every_recording_once_and_its_report_judges_by_those_held_out(recorded, capfd, refused):
    assert app.run(line(recorded, "-n", "3")) == 0
    assert "RECORDED" in capfd.readouterr().out
    session = api.open_session("pendulum-swings")
    actions = np.array([trial.action_array for trial in session.trials])
    assert len(actions) == 6
    assert len(np.unique(actions, axis=0)) == len(actions)
    assert "ran on recorded trials" in refused(2, "rollout", "--session", session.name, "--best", "--yes")
    page = (session.folder / "report.html").read_text()
    assert "Predicted against observed" in page
    assert "16 trials held out" in page
    assert " rad</td>" in page
    assert "elieve the posterior" in page
    assert "SIMULATED" not in page


def test_it_can_be_begun_in_python_and_another_seed_holds_out_other_trials(recorded):
    shown = []
    for seed in (0, 1):
        session = api.begin("pendulum", recorded=str(recorded), held_out=0.25, seed=seed)
        session.run_iteration()
        shown.append({t.action["k11"] for t in session.trials})
        assert session.facts.recorded == str(recorded)
        assert session.facts.held_out == 0.25
    assert shown[0] != shown[1]


def test_a_changed_recording_stops_the_session(tmp_path, refused):
    folder = write_tables(tmp_path / "lab", 24)
    assert app.run(line(folder)) == 0
    lines = (folder / "trajectories.csv").read_text().splitlines()
    lines[1] = lines[1].replace(lines[1].split(",")[2], "-3.0", 1)
    (folder / "trajectories.csv").write_text("\n".join(lines) + "\n")
    assert "the recording has changed since session" in refused(2, *line(folder))


def test_a_session_ends_with_one_line_when_all_recordings_are_used(tmp_path, refused):
    folder = write_tables(tmp_path / "few", 10)
    assert app.run(line(folder, "-n", "5", "--held-out", "0")) == 0
    assert "recorded trials" in refused(3, *line(folder, "-n", "1", "--held-out", "0"))


def test_a_real_arm_and_another_solver_are_refused(recorded, refused):
    assert "leave out --solver naf" in refused(2, *line(recorded, "--solver", "naf"))


def own_session(folder: Path) -> Path:
    """Trials of a session of this program."""
    begun = ["run-iteration", "--task", "pendulum", "--world", "wd", "--method", "random", "--session", "old"]
    assert app.run([*begun, "-n", "4", "--yes"]) == 0
    return folder.parent / "home/data/sessions/old"


@pytest.mark.parametrize("source", [write_tables, write_mcap, own_session])
def test_a_session_runs_to_its_verdict_from_the_files_of_any_program_and_again_to_the_same_numbers(source, tmp_path):
    folder, found = source(tmp_path / "lab"), []
    recorded = {tuple(action) for action in read_recorded(TASK, folder).actions}
    for name, runs in (("at-once", ("2",)), ("in-two", ("1", "1"))):
        for count in runs:
            assert app.run(line(folder, "-n", count, "--session", name)) == 0
        session = api.open_session(name)
        *_, last = session.iterations
        assert last.number == 2
        assert last.verdict.trials == len(session.trials) == 4
        assert {tuple(trial.action_array) for trial in session.trials} <= recorded
        assert f"reward {last.verdict.reward:.2f}" in (session.folder / "report.html").read_text()
        found.append(([t.action for t in session.trials], [t.reward for t in session.trials], last.verdict))
    assert found[0] == found[1]


def test_too_few_trials_get_one_line_and_no_session(tmp_path, refused):
    assert "there are 7 recorded trials, and at least 8 are needed" in refused(
        8, *line(write_tables(tmp_path / "lab", 7))
    )
    assert not (tmp_path / "home/data/sessions").exists()


def test_a_session_goes_on_where_it_was_and_gets_the_same_numbers(recorded: Path) -> None:
    for count, name in (("1", "twice"), ("1", "twice"), ("2", "once")):
        assert app.run(line(recorded, "-n", count, "--session", name)) == 0
    twice, once = (api.open_session(name) for name in ("twice", "once"))
    assert [t.action for t in twice.trials] == [t.action for t in once.trials]
    assert [t.reward for t in twice.trials] == [t.reward for t in once.trials]
