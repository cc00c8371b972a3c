"""Tracking again from what a session holds: the same result, another tracker's result, and what cannot be tracked."""

from __future__ import annotations

import dataclasses
import json
import re
from typing import NoReturn

import numpy as np
import pytest
import toy_rig
from adaptsim_cli.bench.rig import Tracker, TrackRequest
from scipy.spatial.transform import Rotation
from toy_rig import TASK, ToyLab

import sim.tasks
from adaptsim_cli.bench.devices import trackers
from adaptsim_cli.commands import app
from adaptsim_cli.session import recording, retracking
from adaptsim_cli.session.correcting import amend
from adaptsim_cli.session.rig_target import RigTarget
from adaptsim_cli.session.store import SessionStore
from hw.types import CameraModel, Execution, Frame
from perception.errors import ObjectNotFound
from perception.types import ObjectTrack, Outcome


@pytest.fixture
def tracker() -> Tracker:
    """The toy rig's, except that its one bright pixel is found where JPEG has dimmed it."""

    def find(frame: Frame, model: CameraModel, X_BC: np.ndarray) -> toy_rig.Found:
        red = frame.colour[..., 0].astype(int)
        v, u = np.unravel_index(int(red.argmax()), red.shape)
        return toy_rig.Found(np.array([0.68 + (u - 31.5) / 500, -(v - 23.5) / 500]))

    target = toy_rig.toy_parts(ToyLab(0)).target
    assert isinstance(target, RigTarget)
    return dataclasses.replace(target.tracker, find=find)


def contents(store: SessionStore) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(store.folder.rglob("*")) if path.is_file()}


def test_the_same_tracker_comes_to_the_stored_result_and_nothing_is_edited(store, tracker):
    before = contents(store)
    found = list(retracking.retrack(store, TASK, tracker, None))
    assert [one.trial for one in found] == [1, 2, 3, 4]
    for one in found:
        assert one.same_outcome and one.failure is None and one.now is not None
        assert one.now.reward == pytest.approx(one.stored.reward, abs=1e-6)
        assert one.end_apart_mm == pytest.approx(0.0, abs=1e-3) and one.most_apart_mm == pytest.approx(0.0, abs=1e-3)
        assert one.now.context == pytest.approx(one.stored.context, abs=1e-6)
    assert contents(store) == before


def test_another_tracker_shows_as_a_difference(store, tracker):
    def shifted(request: TrackRequest) -> ObjectTrack:
        old = tracker.track(request)
        moved = old.state + np.linspace(0, 0.005, len(old.t_s))[:, None] * [1.0, 0, 0]
        return dataclasses.replace(old, state=moved, outcome=Outcome.ON_TABLE)

    changed = dataclasses.replace(tracker, track=shifted)
    (one,) = retracking.retrack(store, TASK, changed, 2)
    assert one.now is not None and one.now.reward == 0.0 and not one.same_outcome
    assert one.end_apart_mm == pytest.approx(5.0) and one.most_apart_mm == pytest.approx(5.0)
    assert retracking.rows([one])[0][:3] == ("2", "on blade", "on table")


def test_an_overruled_outcome_is_compared_as_it_was_tracked(store, tracker):
    amend(store, TASK, 2, Outcome.ON_TABLE, 0.0, "seen on the recording")
    (one,) = retracking.retrack(store, TASK, tracker, 2)
    assert (one.stored.outcome, one.stored.tracked_outcome, one.same_outcome) == ("on_table", "on_blade", True)
    assert retracking.rows([one])[0][1] == "on table (operator)"


def test_the_pose_of_the_tool_is_the_stored_one_and_turns_evenly_between_images(tmp_path):
    def X_BT_at(t_s: float) -> np.ndarray:
        X = np.eye(4)
        X[:3, :3] = Rotation.from_rotvec([0.0, 3.0 * (t_s - 12.0), 0.0]).as_matrix()
        X[:3, 3] = [0.6, 0.2 * (t_s - 12.0), 0.1]
        return X

    frames = [Frame(12.0 + i / 30, np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint16)) for i in range(4)]
    played = Execution(12.0, np.array([0.0, 0.1]), np.zeros((2, 7)), np.zeros((2, 7)), 1.0)
    path = tmp_path / recording.FILE
    film = [recording.stored(frame) for frame in frames]
    path.write_bytes(recording.begin(film[0], film, toy_rig.MODEL, toy_rig.X_BC, played, X_BT_at).finish(None)[0])
    found = retracking.tool_poses(path)
    for t_s in (12.0, 12.0 + 1 / 30, 12.05, 12.1):
        assert np.allclose(found(t_s), X_BT_at(t_s), atol=1e-7)
    assert np.allclose(found(11.0), X_BT_at(12.0)) and np.allclose(found(13.0), X_BT_at(12.1), atol=1e-7)


@pytest.fixture
def toy(monkeypatch, tracker: Tracker) -> None:
    """The toy task among the registered ones."""
    monkeypatch.setattr(sim.tasks, "get_task", lambda name: TASK)
    monkeypatch.setitem(trackers.TRACKERS, "toy", lambda task: tracker)


def test_the_command_prints_a_table_or_one_object(store, toy, capfd, printed):
    assert app.run(["retrack", store.facts.name]) == 0
    out = capfd.readouterr().out
    assert out.count("on blade") == 8 and "most apart" in out
    (one,) = printed("retrack", store.facts.name, "--trial", "3", "--json")["trials"]
    assert (one["trial"], one["same_outcome"], one["failure"]) == (3, True, None)
    assert one["now"]["reward"] == pytest.approx(one["stored"]["reward"], abs=1e-6)


def test_a_trial_that_does_not_count_is_refused_with_those_that_do(store, toy, capfd):
    assert app.run(["retrack", store.facts.name, "--trial", "9"]) == 2
    assert_told(capfd, "--trial 9: no such trial of .* is completed and counts; there are: 1, 2, 3, 4")


def test_a_task_without_a_camera_is_refused(store, monkeypatch, capfd):
    monkeypatch.setattr(sim.tasks, "get_task", lambda name: dataclasses.replace(TASK, hardware=None))
    assert app.run(["retrack", store.facts.name]) == 2
    assert_told(capfd, "runs in simulation only: its sessions have no recordings")


def test_a_trial_that_cannot_be_tracked_ends_with_6_after_the_table(store, toy, tracker, monkeypatch, capfd):
    def blind(*_: object) -> NoReturn:
        raise ObjectNotFound("nothing looks like it")

    monkeypatch.setitem(trackers.TRACKERS, "toy", lambda task: dataclasses.replace(tracker, find=blind))
    assert app.run(["retrack", store.facts.name, "--json"]) == 6
    out, err = capfd.readouterr()
    told = json.loads(out)["trials"]
    assert [(one["failure"], one["now"], one["end_apart_mm"]) for one in told] == [
        ("nothing looks like it", None, None)
    ] * 4
    assert "4 of 4" in err and "trial 1: nothing looks like it" in " ".join(err.split())


def assert_told(capfd: pytest.CaptureFixture[str], pattern: str) -> None:
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err and re.search(pattern, " ".join(err.split())), err
