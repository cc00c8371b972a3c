"""What is kept of a motion that is over when something comes between it and the review, and how the trial goes on."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from toy_rig import OUTCOMES, ToyLab, rig_target
from toy_session import NAME, ScriptedOperator, attended, run, silent, summary

from adaptsim_cli.bench.rig import Recording, Tracker, TrackRequest
from adaptsim_cli.errors import Interrupted, SessionError, StoppedByOperator
from adaptsim_cli.session import recording
from adaptsim_cli.session.correcting import redo
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.operator import Attended, Choices, Review, Unattended
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore
from hw.errors import ArmFault, CameraError
from hw.types import Execution, JointPath
from perception.errors import TrackingFailed
from perception.sightings import OutcomeUnseen
from perception.types import ObjectTrack
from sim.adaptation.stages import TrialKey

SECOND = TrialKey(2, 0)
Change = Callable[[Tracker], Tracker]


class AtReview(ScriptedOperator):
    """Does not answer the second review, but what comes instead."""

    def __init__(self, instead: BaseException) -> None:
        super().__init__()
        self._instead, self._reviewed = instead, 0

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        self._reviewed += 1
        if self._reviewed == 2:
            raise self._instead
        return super().review(tracked, choices)


def failing(error: BaseException) -> Change:
    """A tracker that fails at the second trial."""
    seen = 0

    def changed(tracker: Tracker) -> Tracker:
        def track(request: TrackRequest) -> ObjectTrack:
            nonlocal seen
            seen += 1
            if seen == 2:
                raise error
            return tracker.track(request)

        return dataclasses.replace(tracker, track=track)

    return changed


def with_tracker(session: RunningSession, change: Change) -> RunningSession:
    target = rig_target(session.parts)
    target = dataclasses.replace(target, tracker=change(target.tracker))
    return dataclasses.replace(session, parts=dataclasses.replace(session.parts, target=target))


def stop_at_second_review(home: Path, name: str = "fake") -> SessionStore:
    session = attended(home, AtReview(StoppedByOperator("q")), ToyLab(0), name)
    with pytest.raises(StoppedByOperator):
        run_iteration(session)
    return session.store


def recorded(store: SessionStore, key: TrialKey = SECOND) -> Recording:
    return recording.read(store.trial_folder(0, key) / recording.FILE)


def reason(store: SessionStore, key: TrialKey = SECOND) -> str:
    folder = store.trial_folder(0, key)
    return str(json.loads(folder.with_name(f"{folder.name}.rejected.json").read_text())["text"])


@pytest.mark.parametrize(
    ("name", "moment", "instead"),
    [
        ("fake", "tracking", KeyboardInterrupt()),
        ("fake", "review", StoppedByOperator("q")),
        ("panda", "review", KeyboardInterrupt()),
    ],
)
def test_a_trial_cut_short_after_its_motion_goes_on_from_its_recording(name, moment, instead, undisturbed, tmp_path):
    operator = AtReview(instead) if moment == "review" else ScriptedOperator()
    session = attended(tmp_path, operator, ToyLab(0), name)
    if moment == "tracking":
        session = with_tracker(session, failing(instead))
    with pytest.raises(type(instead)):
        run_iteration(session)
    assert session.store.existing().recorded == {SECOND}
    assert len(recorded(session.store).frames) == 6
    moving_s = session.store.motion(0, SECOND).timing_s["moving"]

    again, lab = ScriptedOperator(), ToyLab(0)
    continued = attended(tmp_path, again, lab, name)
    run_iteration(continued)
    assert lab.executions == [(3, 0), (4, 0)], "the motion is not repeated"
    assert again.asked[0] == "place the toy piece", "the first question is about the next trial"
    assert continued.store.existing().rejected == frozenset(), "and no attempt is spent"
    assert summary(continued.store, 0)["particles"] == summary(undisturbed, 0)["particles"]
    assert continued.store.trial(0, SECOND).files == undisturbed.trial(0, SECOND).files
    assert continued.store.trial(0, SECOND).timing_s["moving"] == moving_s


def searching(finds: list[int]) -> Change:
    """A tracker that counts how often it searches a picture."""

    def changed(tracker: Tracker) -> Tracker:
        def find(*picture: Any) -> Any:
            finds.append(1)
            return tracker.find(*picture)

        return dataclasses.replace(tracker, find=find)

    return changed


def test_the_object_is_searched_once_for_action_and_track_and_again_in_a_recording_that_was_read(tmp_path):
    finds = list[int]()
    session = with_tracker(attended(tmp_path, AtReview(StoppedByOperator("q")), ToyLab(0)), searching(finds))
    with pytest.raises(StoppedByOperator):
        run_iteration(session)
    assert len(finds) == 2, "once for each of two trials"
    run_iteration(with_tracker(attended(tmp_path, ScriptedOperator(), ToyLab(0)), searching(finds)))
    assert len(finds) == 2 + 3, "the second trial goes on from its recording, and two more are made"


def test_the_review_comes_again_and_may_be_answered_otherwise(tmp_path):
    stop_at_second_review(tmp_path)
    lab = ToyLab(0)
    session = attended(tmp_path, ScriptedOperator(reviews=[Review(rejected="the piece was touched")]), lab)
    run_iteration(session)
    assert lab.executions == [(2, 1), (3, 0), (4, 0)]
    assert reason(session.store) == "the piece was touched"
    assert len(recorded(session.store).frames) == 6, "a redone trial keeps its recording"
    assert (session.store.trial_folder(0, SECOND) / FILM).is_file()


def test_a_trial_that_could_not_be_tracked_keeps_its_recording(tmp_path):
    operator, lab = ScriptedOperator(), ToyLab(0)
    session = with_tracker(attended(tmp_path, operator, lab), failing(TrackingFailed("out of sight")))
    run_iteration(session)
    assert lab.executions == [(1, 0), (2, 0), (2, 1), (3, 0), (4, 0)]
    assert "again 2.0" in operator.asked
    assert reason(session.store) == "out of sight"
    assert len(recorded(session.store).frames) == 6
    assert not (session.store.trial_folder(0, SECOND) / "trial.json").exists()
    assert [t.attempt for t in session.store.trials(0)] == [1, 2, 1, 1]


def unseen(followed: bool) -> Change:
    """A tracker that does not see the end of the second trial."""
    seen = 0

    def changed(tracker: Tracker) -> Tracker:
        def track(request: TrackRequest) -> ObjectTrack:
            nonlocal seen
            seen += 1
            track = tracker.track(request)
            if seen == 2:
                raise OutcomeUnseen("seen in 0 of its last 6 frames", track, followed)
            return track

        return dataclasses.replace(tracker, track=track)

    return changed


def test_a_person_says_how_a_trial_ended_that_the_camera_did_not_see(tmp_path):
    outcome = OUTCOMES[1]
    operator, lab = ScriptedOperator(reviews=[Review(), Review(outcome)]), ToyLab(0)
    session = with_tracker(attended(tmp_path, operator, lab), unseen(followed=True))
    run_iteration(session)
    assert lab.executions == [(1, 0), (2, 0), (3, 0), (4, 0)]
    assert "decide 2" in operator.asked
    assert session.store.trials(0)[1].outcome is outcome


@pytest.mark.parametrize("followed", [True, False])
def test_or_the_trial_is_made_again(tmp_path, followed):
    operator, lab = ScriptedOperator(), ToyLab(0)
    run_iteration(session := with_tracker(attended(tmp_path, operator, lab), unseen(followed)))
    assert lab.executions == [(1, 0), (2, 0), (2, 1), (3, 0), (4, 0)]
    assert ("decide 2" in operator.asked) is followed, "what was hardly followed is no trial, whatever a person says"
    assert "seen in 0 of its last" in reason(session.store)


def test_nobody_at_the_terminal_repeats_it_and_a_person_has_no_default(tmp_path, monkeypatch):
    session = with_tracker(attended(tmp_path, Unattended(silent()), lab := ToyLab(0)), unseen(followed=True))
    run_iteration(session)
    assert lab.executions == [(1, 0), (2, 0), (2, 1), (3, 0), (4, 0)]
    record = session.store.trials(0)[0]
    screen = silent()
    answers = iter(["", "r"])
    monkeypatch.setattr(screen, "ask", lambda *_: next(answers))
    assert Attended(screen).decide("not seen", record, {}) == Review(rejected="not seen"), "Enter alone says nothing"


def reflex(home: Path, lab: ToyLab, at: TrialKey = SECOND, **how: Any) -> RunningSession:
    """A session whose arm stops at one trial."""
    session = attended(home, ScriptedOperator(), lab)
    object.__setattr__(rig_target(session.parts).rig, "arm", Reflex(lab, at, **how))
    return session


@pytest.mark.parametrize(("films", "samples"), [(True, 0), (False, 201)], ids=["half way", "on the way back"])
def test_an_arm_that_stops_leaves_what_was_recorded(tmp_path, *, films, samples):
    session = reflex(tmp_path, ToyLab(0), recording=films)
    with pytest.raises(ArmFault, match="reflex"):
        run_iteration(session)
    assert reason(session.store) == session.store.motion(0, SECOND).stopped == "reflex"
    kept = recorded(session.store)
    assert len(kept.frames) == 6
    assert len(kept.execution.t_s) == samples, "an arm that stops half way does not say where it was"


def test_a_stopped_motion_whose_rejection_was_cut_short_is_no_trial(tmp_path, monkeypatch):
    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(SessionStore, "reject", killed)
        run_iteration(reflex(tmp_path, ToyLab(0)))
    after = ToyLab(0)
    store = run(tmp_path, after)
    assert after.executions == [(2, 1), (3, 0), (4, 0)]
    assert reason(store) == "reflex"


@pytest.mark.parametrize(("first", "told"), [(KeyboardInterrupt(), Interrupted), (ArmFault("reflex"), ArmFault)])
def test_the_camera_is_stopped_whatever_happens_and_never_hides_it(first, told, tmp_path):
    stopped = []

    def no_frame(trial: int, attempt: int) -> None:
        stopped.append(trial)
        raise CameraError("no frame")

    session = reflex(tmp_path, ToyLab(0, hooks={"stop_recording": no_frame}), TrialKey(1, 0), error=first)
    with pytest.raises(told):
        run_iteration(session)
    assert stopped == [1]


def test_a_recording_that_waits_for_its_review_can_be_redone(tmp_path):
    assert redo(stop_at_second_review(tmp_path), 2, "never mind") == 2
    lab = ToyLab(0)
    run(tmp_path, lab)
    assert lab.executions == [(2, 1), (3, 0), (4, 0)]


def test_a_damaged_recording_that_waits_for_its_review_is_named(tmp_path):
    path = stop_at_second_review(tmp_path).trial_folder(0, SECOND) / recording.FILE
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(SessionError, match=r"trial-002-attempt-1/recording\.mcap"):
        run(tmp_path)
    assert SessionStore.open(tmp_path / "data" / "sessions", NAME).existing().recorded == {SECOND}


class Reflex:
    """The toy lab's arm, which stops in the recorded motion of one trial, or on the way back from it."""

    def __init__(
        self, lab: ToyLab, at: TrialKey, *, recording: bool = True, error: BaseException | None = None
    ) -> None:
        self._lab, self._at, self._recording = lab, at, recording
        self._error = error or ArmFault("reflex")

    @property
    def model(self) -> str:
        return "panda"

    def __getattr__(self, name: str) -> object:
        return getattr(self._lab, name)

    def execute(self, path: JointPath) -> Execution:
        films = self._lab._recording is not None
        played = self._lab.execute(path)
        over = bool(self._lab.executions) and self._lab.executions[-1] == tuple(self._at)
        if over and films == self._recording:
            raise self._error
        return played
