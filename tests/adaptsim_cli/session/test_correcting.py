"""Second thoughts about a trial: a rejection taken back, an outcome set anew, and what later iterations say of it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import pytest
from toy_rig import OUTCOMES, TASK, ToyLab
from toy_session import NAME, ScriptedOperator, attended, run

from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session import correcting
from adaptsim_cli.session.correcting import amend, amendable, redo, restore
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.live_trial import PlannedTrial
from adaptsim_cli.session.operator import Choices, Review
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from perception.types import Outcome


def opened(home: Path) -> SessionStore:
    return SessionStore.open(home / "data" / "sessions", NAME)


@pytest.fixture
def home(store: SessionStore, place) -> Path:
    """Of a session of one iteration."""
    return place.parent / "home"


def changed(store: SessionStore, number: int, outcome: Outcome) -> str:
    _, choices = amendable(store, TASK, OUTCOMES, number)
    return amend(store, TASK, number, outcome, choices[outcome], "seen on the recording")[1]


def test_a_rejection_is_taken_back_and_its_recording_is_reviewed_again(tmp_path):
    lab = ToyLab(0)
    operator = ScriptedOperator(reviews=[Review(rejected="slip of the finger")])
    operator.before_motion = lambda made: stop_at_second(made.attempt - 1)

    def stop_at_second(attempt: int) -> None:
        if attempt == 1:
            raise StoppedByOperator("not again")

    with pytest.raises(StoppedByOperator):
        run_iteration(attended(tmp_path, operator, lab))
    assert restore(opened(tmp_path), 1, None, "it was good")[0].attempt == 1
    again = ToyLab(0)
    run_iteration(attended(tmp_path, ScriptedOperator(), again))
    assert again.executions == [(2, 0), (3, 0), (4, 0)], "the motion of the restored trial is not made again"
    assert [t.attempt for t in opened(tmp_path).trials(0)] == [1, 1, 1, 1]
    assert verify(tmp_path / "data" / "sessions", NAME).damage == ()


def test_of_two_attempts_either_can_count_and_each_change_adapts_again(store, home):
    redo(store, 2, "the piece was touched")
    run(home)
    assert [t.attempt for t in opened(home).trials(0)] == [1, 2, 1, 1]
    assert (store.folder / "iteration-01" / "result-1").is_dir(), "the earlier result is kept"
    restore(opened(home), 2, None, "it was not")
    run(home)
    store = opened(home)
    assert [t.attempt for t in store.trials(0)] == [1, 1, 1, 1]
    result = store.result(0)
    (amended,) = result.amended
    assert "trial 2" in amended and "it was not" in amended
    assert redo(store, 2, "it was after all") == 3, "done again means a new attempt, not the one of before"
    lab = ToyLab(0)
    run(home, lab)
    assert lab.executions == [(2, 2)]
    assert [t.attempt for t in opened(home).trials(0)] == [1, 3, 1, 1]
    restore(opened(home), 2, 1, "the second was best")
    assert [t.attempt for t in opened(home).trials(0)] == [1, 2, 1, 1]


def test_an_amended_outcome_counts_and_the_new_result_says_so(store, home):
    before = store.trials(0)[2]
    assert before.outcome is Outcome.ON_BLADE
    assert "adapts again" in changed(store, 3, Outcome.ON_TABLE)
    after = opened(home).trials(0)[2]
    assert (after.outcome, after.reward, after.overruled_from) == (Outcome.ON_TABLE, 0.0, Outcome.ON_BLADE)
    lab = ToyLab(0)
    run(home, lab)
    assert lab.executions == [], "nothing moves"
    result = opened(home).result(0)
    assert result is not None and result.changes == 1
    assert result.amended[0].startswith("trial 3 counts as on table instead of on blade, reward 0.00 instead of ")
    changed(opened(home), 3, Outcome.ON_BLADE)
    assert opened(home).trials(0)[2] == before, "back to what tracking had said"


@pytest.mark.long
def test_later_iterations_keep_what_they_were_made_with_and_the_next_result_says_what_changed(tmp_path):
    store = run(tmp_path, iterations=2)
    first = store.result(0)
    assert "Iteration 2 was made with policies from before" in changed(store, 1, Outcome.ON_TABLE)
    lab = ToyLab(0)
    run(tmp_path, lab)
    store = opened(tmp_path)
    assert lab.executions == []
    assert store.result(0) == first, "later trials rest on it"
    second = store.result(1)
    assert second is not None and second.changes == 1
    assert "trial 1 " in second.amended[0]
    run(tmp_path)
    third = opened(tmp_path).result(2)
    assert third is not None and (third.changes, third.amended) == (1, ())


def test_what_cannot_be_restored_or_amended_says_why(store):
    with pytest.raises(UsageError, match="trial 1 "):
        restore(store, 1, None, "")
    with pytest.raises(UsageError, match=r"trial 9 .* 1, 2, 3, 4"):
        amendable(store, TASK, OUTCOMES, 9)
    with pytest.raises(UsageError, match="on blade"):
        amend(store, TASK, 1, Outcome.ON_BLADE, 1.0, "")
    redo(store, 4, "bad")
    with pytest.raises(UsageError, match=r"--attempt 2: .* trial 4 .*: 1"):
        restore(store, 4, 1, "")


def test_a_restored_attempt_may_be_rejected_and_restored_once_more(tmp_path):
    class Undecided(ScriptedOperator):
        def review(self, tracked: TrialRecord, choices: Choices) -> Review:
            return Review(rejected="no")

        def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
            if trial.attempt > 1:
                raise StoppedByOperator("later")

    for _ in range(2):
        with pytest.raises(StoppedByOperator):
            run_iteration(attended(tmp_path, Undecided(), ToyLab(0)))
        restore(opened(tmp_path), 1, None, "yes")
    run_iteration(attended(tmp_path, ScriptedOperator(), ToyLab(0)))
    assert opened(tmp_path).trials(0)[0].attempt == 1
    assert len(list(opened(tmp_path).iteration_folder(0).glob("trial-001-attempt-1.restored*.json"))) == 2


def test_a_clock_that_goes_backwards_mixes_up_no_changes(store, home, monkeypatch):
    """Each result names the changes since the result before it, and no others."""
    hours = iter(range(20, 0, -5))

    class Backwards(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
            return datetime(2024, 1, 1, tzinfo=UTC) + timedelta(hours=next(hours))

    monkeypatch.setattr(correcting, "datetime", Backwards)
    changed(store, 3, Outcome.ON_TABLE)
    run(home)
    for number in (1, 2):
        changed(opened(home), number, Outcome.LOST)
    run(home)
    result = opened(home).result(0)
    assert [said[: len("trial 1")] for said in result.amended] == ["trial 1", "trial 2"]
