"""Sessions as earlier versions stored them (tests/data/earlier-formats/SOURCE.md) are read, and can be migrated."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adaptsim_cli.commands import app
from adaptsim_cli.errors import SessionError
from adaptsim_cli.session import earlier, keeping, recording
from adaptsim_cli.session.history import particles_of, played_of, results_of
from adaptsim_cli.session.recorded.folder import read_recorded
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.verdict import Kind
from sim.rollouts import recorded as recorded_trials
from sim.tasks import get_task

DATA = Path(__file__).parents[2] / "data" / "earlier-formats"
FORMATS = ("format-1", "format-2", "format-3", "format-4")
FILMED = "format-1-camera"
every_format = pytest.mark.parametrize("name", FORMATS)


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a user's sessions, with one of each earlier format."""
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    shutil.copytree(DATA, root := tmp_path / "data" / "sessions", ignore=shutil.ignore_patterns("*.md"))
    return root


def digest(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def stored_trials(folder: Path) -> dict[tuple[int, int], dict[str, Any]]:
    """The tables of the trials in a folder, by (number, attempt from 1)."""
    first = json.loads(next(iter(sorted(folder.glob("iteration-*/trial-001-*/trial.json")))).read_text())["attempt"]
    tables = [json.loads(path.read_text()) for path in folder.glob("iteration-*/trial-*/trial.json")]
    return {(table["number"], table["attempt"] + 1 - first): table for table in tables}


@every_format
def test_a_command_that_cannot_read_it_names_the_command_that_can(
    name: str, root: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["sessions", "show", name]) == 8
    said = " ".join(capfd.readouterr().err.split())
    assert f"`adaptsim sessions migrate {name}`" in said
    assert name == "format-4" or "of format " + name[-1] + ", written by adaptsim 0." in said
    capfd.readouterr()
    assert app.run(["sessions", "verify", name]) == 0
    assert "none" in capfd.readouterr().out


@every_format
def test_a_migrated_session_has_every_trial_with_its_numbers(name: str, root: Path) -> None:
    before, tables = digest(root / name), stored_trials(root / name)
    folder = earlier.migrate(root, name, "new")
    assert keeping.verify(root, "new").damage == ()
    store, counted = SessionStore.open(root, "new"), set()
    for trial in played_of(store):
        table = tables[trial.trial, trial.attempt]
        assert list(trial.action.values()) == table["action"]
        assert list(trial.context.values()) == table["context"]
        assert (trial.reward, trial.predicted_reward) == (table["reward"], table["predicted_reward"])
        assert trial.outcome == table["outcome"]
        particle = particles_of(store, trial.iteration - 1)[trial.particle - 1]
        assert np.array_equal(list(trial.parameters.values()), particle.mean)
        counted.add((trial.trial, trial.attempt))
    assert {number for number, _ in counted} == {number for number, _ in tables}
    assert all((folder / f"iteration-{result.iteration:02d}").is_dir() for result in results_of(store))
    assert digest(root / name) == before, "the old one stays as it is"
    with pytest.raises(SessionError, match="exists already"):
        earlier.migrate(root, name, "new")
    with pytest.raises(SessionError, match="of this version's format"):
        earlier.migrate(root, "new", "newer")


def test_rejected_attempts_and_sentences_of_verdicts_keep_their_meaning(root: Path) -> None:
    earlier.migrate(root, "format-2", "new")
    store = SessionStore.open(root, "new")
    assert [(trial.trial, trial.attempt) for trial in played_of(store)] == [(1, 1), (2, 2)]
    (rejection,) = store.rejections()
    assert (rejection.key.number, rejection.key.attempt, rejection.note.text) == (2, 0, "the camera was touched")
    (result,) = results_of(store)
    assert (result.keys, result.verdict.kind) == (tuple(trial.position[1] for trial in played_of(store)), Kind.ENOUGH)


@every_format
def test_a_session_of_an_earlier_format_has_its_report(name: str, root: Path) -> None:
    before = digest(root / name)
    assert app.run(["report", name]) == 0
    page = (root / name / "report.html").read_text()
    newest = sorted(root.glob(f"{name}/iteration-*/result-*/result.json"))[-1]
    assert f"{json.loads(newest.read_text())['best']['mean_reward']:.2f}" in page
    assert {path: content for path, content in digest(root / name).items() if path.suffix != ".html"} == before


def test_sessions_of_earlier_formats_are_recorded_trials(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = ["format-1", "format-3"]
    monkeypatch.setattr(recorded_trials, "LEAST", 5)  # the stored sessions are short
    (root / "recorded.toml").write_text(f'task = "pendulum"\nsessions = {json.dumps(chosen)}\n')
    recorded = read_recorded(get_task("pendulum"), root)
    actions = [table["action"] for name in chosen for table in stored_trials(root / name).values()]
    assert len(recorded) == len({tuple(action) for action in actions})
    assert {tuple(action) for action in recorded.actions.tolist()} == {tuple(action) for action in actions}


def test_the_recordings_of_a_migrated_session_are_read_with_their_depth_as_png(root: Path) -> None:
    folder = earlier.migrate(root, FILMED, "new")
    recordings = sorted(folder.rglob(recording.FILE))
    assert len(recordings) == 2
    for path in recordings:
        film = recording.read(path)
        depth_m = np.stack([frame.depth_mm for frame in (film.before, *film.frames)]) / 1000.0
        assert depth_m.shape == (3, 144, 160)
        # The camera's height above the table bounds every reading of the table below it.
        assert 0.4 < np.median(depth_m[depth_m > 0]) < 1.5 * film.X_BC[2, 3]


@pytest.mark.long
def test_a_migrated_session_is_tracked_again(root: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Its films were cut to their first two images, so the tracker has to say that they end too early."""
    earlier.migrate(root, FILMED, "new")
    assert app.run(["retrack", "new"]) != 0
    said = " ".join(capfd.readouterr().err.split())
    assert "2 of 2 trials cannot be tracked now; trial 1: the film ends at 0.06 s, and the motion at 1.00 s" in said


def test_a_damaged_session_of_an_earlier_format_is_not_migrated(root: Path) -> None:
    trial = root / "format-3/iteration-01/trial-001-attempt-1/trial.json"
    trial.write_text(trial.read_text().replace('"reward": 0', '"reward": 1'))
    with pytest.raises(SessionError, match=r"trial\.json is corrupt .*SHA-256 is another"):
        earlier.migrate(root, "format-3", "new")
    assert not (root / "new").exists()
    assert not list(root.glob(".new*"))
