"""Where the time of an iteration goes: the stages add up to the time that passed, whatever happened in between."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from toy_rig import ToyLab
from toy_session import NAME, ScriptedOperator, attended, resolved

from adaptsim_cli.session.flow import REJECTED, TOTAL, RunningSession, run_iteration
from adaptsim_cli.session.operator import Review
from adaptsim_cli.session.records import ResultRecord
from adaptsim_cli.session.store import SessionStore


def timed(session: RunningSession) -> tuple[float, ResultRecord]:
    """Wall time of an iteration in s, and its result."""
    session.screen.lap_s()  # as a command does when everything is loaded
    began = time.perf_counter()
    run_iteration(session)
    took_s = time.perf_counter() - began
    result = session.store.result(0)
    assert result is not None
    return took_s, result


def test_the_stages_add_up_to_the_wall_time_of_the_iteration(tmp_path: Path) -> None:
    session = attended(tmp_path, ScriptedOperator())
    took_s, result = timed(session)
    trials = [sum(trial.timing_s.values()) for trial in session.store.trials(0)]
    assert all(trials) and sum(trials) < min(took_s, result.timing_s[TOTAL])
    stages = {name: spent for name, spent in result.timing_s.items() if name != TOTAL}
    assert sum(stages.values()) == pytest.approx(result.timing_s[TOTAL])
    assert result.timing_s[TOTAL] == pytest.approx(took_s, rel=0.1, abs=0.05), "only the result itself is stored later"
    assert {"placing", "finding", "planning", "checking", "moving", "storing", "tracking", "other"} <= set(stages)


def test_a_rejected_attempt_takes_its_time_too(tmp_path: Path) -> None:
    operator = ScriptedOperator(reviews=[Review(), Review(rejected="touched"), Review()])
    took_s, result = timed(attended(tmp_path, operator))
    assert result.timing_s[REJECTED] > 0.0
    assert result.timing_s[TOTAL] == pytest.approx(took_s, rel=0.1, abs=0.05)


def test_a_trial_that_went_on_from_its_recording_keeps_the_time_of_its_motion(tmp_path: Path) -> None:
    lab = ToyLab(0)
    session = attended(tmp_path, ScriptedOperator(), lab)

    def stop(*_: object) -> object:
        raise KeyboardInterrupt

    object.__setattr__(session.operator, "review", stop)
    with pytest.raises(KeyboardInterrupt):
        run_iteration(session)
    again = attended(tmp_path, ScriptedOperator(), lab)
    run_iteration(again)
    store = SessionStore.open(resolved(tmp_path).places.sessions, NAME)
    key = store.trials(0)[0].place[1]
    moved_s = store.motion(0, key).timing_s["moving"]
    assert store.trials(0)[0].timing_s["moving"] == pytest.approx(moved_s)
