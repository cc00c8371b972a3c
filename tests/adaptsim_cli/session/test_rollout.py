"""One trial by itself: chosen by hand or by a policy, stored whole, nothing adapted."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
import toy_rig
from toy_rig import TASK, ToyLab, opener

from adaptsim_cli.commands import app
from adaptsim_cli.session import opening
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.records import ROLLOUT
from adaptsim_cli.session.store import SessionStore
from hw.errors import MotionRefused
from perception.errors import TrackingFailed
from sim.errors import NotExecutable
from sim.tasks import TASKS

RUN = ["rollout", "--task", "toy", "--yes"]


@pytest.fixture(autouse=True)
def registered(monkeypatch) -> None:
    monkeypatch.setitem(TASKS, "toy", toy_rig.__name__)


@pytest.fixture
def lab(monkeypatch) -> ToyLab:
    lab = ToyLab(0)
    monkeypatch.setattr(opening, "open_parts", opener(lab))
    return lab


def test_the_trial_of_a_policy(lab, tmp_path, printed):
    record = printed(*RUN, "--json", "--out", str(tmp_path / "one"))
    assert record["params"] is not None
    assert 0.0 <= record["reward"] <= 1.0
    store = SessionStore.open(tmp_path, "one")
    (trial,) = trials_of(store)
    assert (trial.reward, trial.action, trial.observation) == (
        record["reward"],
        record["action"],
        tuple(record["observation"]),
    )
    assert (store.trial_folder(*trial.position) / "recording.mcap").stat().st_size > 0
    assert (tmp_path / "one" / "report.html").is_file()


def test_a_rollout_is_listed_shown_and_exported_like_any_session_and_nothing_adapts_in_it(lab, printed, refused):
    printed(*RUN, "--json")
    (row,) = printed("sessions", "list", "--json")["sessions"]
    assert (row["method"], row["trials"], row["iterations"]) == (ROLLOUT, 1, 0)
    name = row["session"]
    assert len(printed("sessions", "show", name, "--json")["trials"]) == 1
    assert printed("sessions", "export", name, "--format", "csv", "--json")["written"]
    assert printed("sessions", "verify", name, "--json")["sessions"][0]["damage"] == []
    assert "nothing adapts in it" in refused(2, "run-iteration", "--session", name, "--yes")
    assert "begin one with adaptsim run-iteration" in refused(8, "run-iteration", "--yes")


def test_an_action_by_hand_is_executed_as_given(lab, printed):
    dimension = TASK.action.dimensions[0]
    name, middle = dimension.name, (dimension.low + dimension.high) / 2
    record = printed(*RUN, "--json", "--action", f"{name}={middle}")
    assert record["action"][name] == pytest.approx(middle)
    assert record["params"] is None


def test_a_context_by_hand_is_where_the_object_is_placed(lab, tmp_path, printed):
    printed(*RUN, "--json", "--context", "x=0.665", "--out", str(tmp_path / "one"))
    (trial,) = trials_of(SessionStore.open(tmp_path, "one"))
    assert trial.drawn_context == {"x": 0.665, "y": TASK.reference_context[1]}


@pytest.mark.parametrize("option", ["--action", "--context", "--param"])
def test_a_wrong_value_moves_nothing(lab, tmp_path, monkeypatch, option, refused):
    def opened(*_: object, **__: object) -> None:
        raise AssertionError("what was typed is checked before anything is loaded or connected")

    monkeypatch.setattr(opening, "open_parts", opened)
    assert "write name=value" in refused(2, *RUN, option, "nonsense=1")
    assert not (tmp_path / "home" / "data" / "sessions").exists()


@pytest.mark.parametrize(
    ("line", "code", "told"),
    [
        ([*RUN, "--out", "one"], 2, "exists already"),
        ([*RUN, "--out", "file/one"], 8, "file"),
        (["rollout", "--task", "toy"], 2, "no terminal"),
    ],
)
def test_what_cannot_be_stored_or_confirmed_is_noticed_before_anything_moves(
    lab, monkeypatch, line, code, told, refused
):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    Path("one").mkdir()
    Path("file").write_text("in the way")
    assert told in refused(code, *line)
    assert lab.executions == []


def test_an_object_that_is_not_found_is_asked_for_again_before_anything_moves(tmp_path, capfd, monkeypatch):
    lab = ToyLab(0, misplaced=frozenset({(1, 0), (1, 1)}))
    monkeypatch.setattr(opening, "open_parts", opener(lab))
    assert app.run([*RUN, "--out", str(tmp_path / "one")]) == 0
    assert capfd.readouterr().out.count("toy piece lies outside") == 2
    assert lab.executions == [(1, 2)]


def test_a_motion_that_cannot_be_tracked_leaves_its_recording(lab, tmp_path, monkeypatch, refused):
    def lost(_: object) -> None:
        raise TrackingFailed("out of sight")

    monkeypatch.setattr(toy_rig, "track", lost)
    assert "out of sight" in refused(6, *RUN, "--out", str(tmp_path / "one"))
    attempts = sorted(path.parent.name for path in (tmp_path / "one").rglob("recording.mcap"))
    assert attempts == [f"trial-001-attempt-{n}" for n in range(1, 6)]  # nobody is there to say that it was enough


@pytest.mark.parametrize("error", [NotExecutable("joint 4 cannot follow"), MotionRefused("joint 4 too fast")])
def test_a_motion_that_cannot_be_made_says_how_to_find_one_that_can(error, lab, tmp_path, capfd, monkeypatch):
    def check(*_: object) -> None:
        raise error

    monkeypatch.setattr(opening, "open_parts", opener(lab, check=check))
    assert app.run([*RUN, "--out", str(tmp_path / "one")]) == 4
    said = capfd.readouterr().err
    assert str(error) in said
    assert "adaptsim preview --task toy" in said
    assert lab.executions == []
    assert not (tmp_path / "one").exists()
