"""adaptsim from Python: a session of the command line and one of the interface are the same thing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptsim_cli import api
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session.recording import Recording
from adaptsim_cli.session.records import Facts, to_toml


@pytest.mark.long
def test_an_iteration_of_python_equals_one_of_the_command_line(printed):
    session = api.begin("pendulum", world="wd", seed=3, name="here")
    done = session.run_iteration()
    printed = printed("run-iteration", "--task", "pendulum", "--seed", "3", "--session", "there", "--yes", "--json")
    assert [t.reward for t in session.trials] == [t["reward"] for p in printed["particles"] for t in p["trials"]]
    assert done.best.params == printed["best"]["params"]
    assert [dict(p) for p in done.next_parameters] == [p["next_params"] for p in printed["particles"]]
    assert (done.number, session.rows()[0]["trial"]) == (1, 1)
    assert api.sessions() == ("here", "there")
    assert [t.reward for t in api.open_session("there").trials] == [t.reward for t in session.trials]


def test_a_name_that_is_taken_or_unknown_is_refused():
    api.begin("pendulum", name="mine")
    with pytest.raises(UsageError, match=r"'mine' exists already.*open_session"):
        api.begin("pendulum", name="mine")
    with pytest.raises(SessionError, match="there is no session 'yours'"):
        api.open_session("yours")


def test_a_real_arm_is_never_moved_from_python():
    session = api.begin("pendulum", name="mine")
    file = session.folder / "session.toml"
    real: Facts = session.facts.model_copy(update={"hw": "fr3"})
    file.write_bytes(to_toml(real))
    with pytest.raises(UsageError, match=r"confirmed at a terminal.*adaptsim run-iteration --session mine"):
        session.run_iteration()


def test_a_recording_is_read_by_its_trial(store):
    session = api.open_session(store.facts.name)
    found = session.recording(1)
    assert isinstance(found, Recording)
    assert len(found.frames) > 2
    path = store.folder / "iteration-01/trial-001-attempt-1/recording.mcap"
    assert np.array_equal(api.read_recording(path).execution.q_measured_rad, found.execution.q_measured_rad)
    with pytest.raises(UsageError, match=r"trial 99 .* completed are 1, 2, 3, 4"):
        session.recording(99)


def test_everything_public_is_there_and_documented():
    page = (Path(__file__).parents[2] / "docs/reference/python.md").read_text(encoding="utf-8")
    for name in api.__all__:
        assert (getattr(api, name).__doc__ or "").strip(), name
    for name in ("begin", "open_session", "sessions", "read_recording"):
        assert f"api.{name}" in page


@pytest.mark.long
def test_the_best_policy_needs_a_complete_iteration() -> None:
    session = api.begin("pendulum")
    assert session.iterations == ()
    with pytest.raises(SessionError, match="no complete iteration"):
        session.best_policy()
    session.run_iteration()
    assert session.best_policy()(np.zeros(0)).shape == (8,)
    assert session.rows()[0]["trial"] == 1
    assert session.report().name == "report.html"
