"""adaptsim from Python: a session of the command line and one of the interface are the same thing."""

from __future__ import annotations

import builtins
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import adaptsim
from adaptsim_cli import api
from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session.records import SessionFacts, to_toml
from sim.errors import NoHardware, OutOfRange
from sim.tasks import files_of

OURS = ("adaptsim_cli", "sim", "hw")
CAMEL = re.compile(r"\b[A-Z][a-z]+(?:[A-Z][a-z]+)+\b")


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


def test_a_session_goes_on_with_the_checkpoint_that_it_was_begun_with(tmp_path):
    own = tmp_path / "mine"
    shutil.copytree(files_of("pendulum", "checkpoints") / "wide", own)
    begun = api.begin("pendulum", name="own-checkpoint", checkpoint=str(own))
    assert begun.facts.checkpoint_folder == str(own)
    assert begun.run_iteration().number == 1
    shutil.rmtree(own)
    assert begun.facts.checkpoint == "pendulum/mine"
    assert len(begun.posterior().quantiles((0.5,))) == 1, "found by its hash among those that ship"
    assert api.begin("pendulum", name="shipped").facts.checkpoint_folder == ""


def test_a_real_arm_is_never_moved_from_python():
    session = api.begin("pendulum", name="mine")
    file = session.folder / "session.toml"
    real: SessionFacts = session.facts.model_copy(update={"hw": "fr3"})
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
    with pytest.raises(UsageError, match=r"trial 99 .* complete trials: 1, 2, 3, 4"):
        session.recording(99)


def test_every_error_that_a_docstring_names_is_public():
    """Of functions, and of the methods of what they return."""
    words = [getattr(api, name).__doc__ or "" for name in api.__all__]
    classes = [one for name in api.__all__ if isinstance(one := getattr(api, name), type)]
    members = [vars(base).items() for one in classes for base in one.__mro__ if base.__module__.startswith(OURS)]
    words += [member.__doc__ or "" for listed in members for name, member in listed if not name.startswith("_")]
    named = {error for text in words for part in re.findall(r"Raises ([^.]*)", text) for error in CAMEL.findall(part)}
    assert {"AnswerRefused", "CheckpointError", "CollapsedPosterior", "ExtraMissing", "UsageError"} <= named
    for name in named:
        assert isinstance(getattr(adaptsim, name, getattr(builtins, name, None)), type), name


def test_everything_public_is_there_and_documented():
    page = (Path(__file__).parents[2] / "docs/reference/python.md").read_text(encoding="utf-8")
    for name in api.__all__:
        assert (getattr(api, name).__doc__ or "").strip(), name
    assert dir(api) == sorted(api.__all__)
    for name in (name for name in api.__all__ if name.islower()):
        assert f"adaptsim.{name}" in page


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


GAIN = [44.2, 6.75, 13.8, 3.01, 3.35, 6.08, 1.79, 1.3]


def test_an_own_policy_is_a_function_an_action_or_an_action_by_name() -> None:
    by_name = dict(zip(("k11", "k12", "k13", "k14", "k21", "k22", "k23", "k24"), GAIN, strict=True))
    tried = [api.rollout("pendulum", one, world="ood-1", n=2) for one in (lambda context: GAIN, GAIN, by_name)]
    assert tried[0] == tried[1] == tried[2]
    assert [row["trial"] for row in tried[0]] == [1, 2]
    assert tried[0][0]["action_k11"] == 44.2
    assert tried[0][0]["succeeded"] is True
    assert tried[0][0]["reward"] == pytest.approx(0.925, abs=0.025)


@pytest.mark.parametrize(
    ("policy", "kind", "told"),
    [
        ([1.0, 2.0], UsageError, "an action has 8 numbers"),
        ({"k11": 1.0}, UsageError, "an action by name has k11, k12"),
        ([*GAIN[:7], 1e3], OutOfRange, r"k24 .* = 1000 lies outside of \[0, 25\]"),
        ([*GAIN[:7], float("nan")], OutOfRange, "= nan lies outside"),
    ],
)
def test_an_impossible_action_names_the_quantity(policy: object, kind: type[Exception], told: str) -> None:
    with pytest.raises(kind, match=told):
        api.rollout("pendulum", policy, n=1)  # type: ignore[arg-type]


def test_a_pendulum_has_no_arm_for_the_lab_and_its_trials_have_curves_instead_of_recordings() -> None:
    with pytest.raises(NoHardware):
        api.rollout("pendulum", GAIN, n=1, through="lab")


@pytest.mark.long
def test_a_session_shows_its_progress_its_learning_curve_and_its_posterior_in_units() -> None:
    session = api.begin("pendulum", world="ood-1", name="mine")
    assert repr(session) == "Session('mine': pendulum in ood-1, adaptsim, seed 0; 0 trials, 0 iterations)"
    session.run_iteration()
    assert "2 trials, 1 iteration, reward 0.00 in the newest" in repr(session)
    assert "<td>1</td><td>2</td><td>0.00</td>" in session._repr_html_()
    (row,) = session.learning_curve()
    assert (row["iteration"], row["trials"]) == (1, 2)
    assert row["mean_reward"] == pytest.approx(np.mean([trial.reward for trial in session.trials]))
    table = session.posterior().table((0.05, 0.95))
    assert [(one["parameter"], one["unit"]) for one in table][:2] == [("m1", "kg"), ("m2", "kg")]
    assert all(float(one["q0.05"]) < float(one["mean"]) < float(one["q0.95"]) for one in table)
    drawn = session.posterior().draw(5, seed=1)
    assert np.array_equal(drawn, session.posterior().draw(5, seed=1))
    assert not np.array_equal(drawn, session.posterior().draw(5, seed=2))
    with pytest.raises(UsageError, match="no camera of adaptsim filmed its trials; adaptsim report mine shows"):
        session.recording(1)
    (tmp := session.folder / "session.toml").unlink()
    assert "Session('mine': " in repr(session), "a broken session is still shown"
    assert not tmp.exists()


@pytest.mark.long
def test_a_benchmark_gives_rows_for_a_data_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = api.benchmark("pendulum", worlds="wd", methods="udr,random", budget=4, seeds=2)
    finals = [row for row in rows if row["is_final"]]
    assert sorted((row["method"], row["seed"]) for row in finals) == [
        ("random", 0),
        ("random", 1),
        ("udr", 0),
        ("udr", 1),
    ]
    assert [row["trials"] for row in rows if row["method"] == "random" and row["seed"] == 0] == [2, 4]


def test_a_cell_that_begins_a_session_may_run_again() -> None:
    first = api.begin("pendulum", seed=1, name="cell", resume=True)
    assert api.begin("pendulum", seed=1, name="cell", resume=True) == first
    with pytest.raises(UsageError, match=r"'cell' was begun with seed = 1, not 2: leave it so, or choose another name"):
        api.begin("pendulum", seed=2, name="cell", resume=True)
    assert api.sessions() == ("cell",)
