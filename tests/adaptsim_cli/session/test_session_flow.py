"""The sequence of a session on the toy rig: order, redo, overruling, faults, resuming."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from real_lab import quiet, said
from toy_rig import PARAMETERS, ToyLab, rig_target
from toy_session import NAME, RUN, ScriptedOperator, attended, call, run, summary, unattended

from adaptsim_cli.errors import Interrupted, StoppedByOperator, UsageError
from adaptsim_cli.session.correcting import redo
from adaptsim_cli.session.flow import REJECTED, run_iteration
from adaptsim_cli.session.folders import OVERLAY
from adaptsim_cli.session.operator import Review, Unattended
from adaptsim_cli.session.records import Draw, MotionRecord, generator
from adaptsim_cli.session.results import TOTAL
from hw.errors import MotionRefused
from perception.errors import ObjectNotFound
from perception.types import SETTLE_S, Outcome
from sim.adaptation.stages import TrialKey


def test_an_iteration_runs_every_trial_and_moves_the_particles(tmp_path):
    lab = ToyLab(0)
    store = run(tmp_path, lab)
    assert lab.executions == [(1, 0), (2, 0), (3, 0), (4, 0)]
    trials = store.trials(0)
    assert [(t.particle, t.trial) for t in trials] == [(1, 1), (1, 2), (2, 3), (2, 4)]
    assert trials[0].context != trials[0].drawn_context, "the context is what the camera measured"
    assert trials[0].context == pytest.approx(trials[0].drawn_context, abs=0.005)
    result = store.result(0)
    assert len(result.next_particles) == 2
    assert (store.folder / "report.html").stat().st_size > 10_000


@pytest.mark.parametrize("other", [{"seed": 4}, {"iteration": 2}, {"particle": 1}, {"trial": 1}, {"attempt": 1}])
def test_every_coordinate_of_a_step_changes_its_random_numbers(other):
    base = {"seed": 3, "iteration": 1, "particle": 0, "trial": 0, "attempt": 0}
    draw = lambda **at: generator(at.pop("seed"), Draw.CONTEXT, **at).random(4)  # noqa: E731
    assert np.array_equal(draw(**base), draw(**base))
    assert not np.array_equal(draw(**base), draw(**(base | other)))
    assert not np.array_equal(draw(**base), generator(3, Draw.NEXT, 1).random(4))


def test_two_runs_of_one_iteration_equal_one_run_of_two(store, place):
    once, lab = run(place / "once", iterations=2), ToyLab(0)
    twice = run(place.parent / "home", lab)
    assert lab.executions == [(5, 0), (6, 0), (7, 0), (8, 0)]
    assert summary(once, 1)["particles"] == summary(twice, 1)["particles"]


def test_policies_of_earlier_iterations_are_let_go(tmp_path):
    session = attended(tmp_path, unattended())
    for iteration in (0, 1):
        run_iteration(session)
        session.store.mark_shown(iteration, "now")
    assert {iteration for iteration, _ in session.policies} == {2}, "only those of the next iteration"


def test_the_camera_goes_on_until_the_object_rests(tmp_path):
    lab, events = ToyLab(0), []
    session = attended(tmp_path, ScriptedOperator(), lab)
    object.__setattr__(session.parts.target.rig, "wait", lambda t_s: events.append((len(lab.executions), t_s)))  # type: ignore[attr-defined]
    lab.hooks["stop_recording"] = lambda trial, _: events.append((trial, 0.0))
    run_iteration(session)
    assert events == [pair for n in range(1, 5) for pair in ((n, SETTLE_S), (n, 0.0))]


def test_an_operator_can_overrule_the_outcome(tmp_path):
    session = attended(tmp_path, ScriptedOperator(reviews=[Review(Outcome.LOST)]))
    run_iteration(session)
    first = session.store.trials(0)[0]
    assert (first.outcome, first.overruled_from, first.reward) == (Outcome.LOST, Outcome.ON_BLADE, 0.0)


def test_a_trial_that_later_ones_rest_on_cannot_be_redone(store, place):
    run(place.parent / "home")
    with pytest.raises(UsageError, match=f"later trials use .* adaptsim sessions amend {NAME} 1"):
        redo(store, 1, "too late")
    with pytest.raises(UsageError, match="trial 99 "):
        redo(store, 99, "never was")


def test_a_misplaced_object_is_asked_for_again_before_anything_moves(tmp_path):
    lab = ToyLab(0, misplaced=frozenset({(2, 0), (2, 1)}))
    operator = ScriptedOperator()
    session = attended(tmp_path, operator, lab)
    run_iteration(session)
    assert lab.executions == [(1, 0), (2, 2), (3, 0), (4, 0)]
    assert [asked for asked in operator.asked if asked.startswith("again")] == ["again 2.0", "again 2.1"]


def test_unattended_a_misplaced_object_ends_in_an_error_after_five_attempts_and_costs_no_finished_trial(tmp_path):
    lab = ToyLab(0, misplaced=frozenset((2, attempt) for attempt in range(9)))
    session = attended(tmp_path, unattended(), lab)
    with pytest.raises(ObjectNotFound, match="area"):
        run_iteration(session)
    assert lab.executions == [(1, 0)]
    assert session.store.existing().completed == {TrialKey(1, 0)}
    picture = session.store.folder / OVERLAY
    assert picture.read_bytes().startswith(b"\xff\xd8"), "the camera's picture, as JPEG"
    assert said(session.screen).count(f"The camera's picture: {picture}") == 5


def test_a_refused_motion_is_not_executed(tmp_path):
    def refuse(path: object) -> None:
        raise MotionRefused("joint 4 at 0.1 s")

    lab = ToyLab(0)
    session = attended(tmp_path, ScriptedOperator(), lab)
    object.__setattr__(rig_target(session.parts).planner, "check", refuse)
    with pytest.raises(MotionRefused):
        run_iteration(session)
    assert lab.executions == []
    assert not list(session.store.folder.rglob("*.started.json"))


def test_stopping_before_a_motion_keeps_the_attempt(tmp_path):
    def stop(trial: MotionRecord) -> None:
        if trial.trial == 2:
            raise StoppedByOperator("enough")

    with pytest.raises(StoppedByOperator):
        run_iteration(attended(tmp_path, ScriptedOperator(before_motion=stop)))
    lab = ToyLab(0)
    run(tmp_path, lab)
    assert lab.executions == [(2, 0), (3, 0), (4, 0)]


def interrupted_in_motion(home: Path) -> None:
    def interrupt(trial: int, attempt: int) -> None:
        if trial == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_iteration(attended(home, ScriptedOperator(), ToyLab(0, hooks={"stop_recording": interrupt})))


@pytest.mark.parametrize("path", ["on the way there", "in mid-motion", "on the way back"])
def test_ctrl_c_says_where_the_arm_stands_and_that_the_trial_does_not_count(path, tmp_path):
    motions = iter(("on the way there", "in mid-motion", "on the way back"))

    def interrupt(trial: int, attempt: int) -> None:
        if next(motions) == path:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match=f"{path}: the arm brakes and stays there. This trial does not count"):
        run_iteration(attended(tmp_path, ScriptedOperator(), ToyLab(0, hooks={"execute": interrupt})))


def test_an_interrupted_motion_is_never_repeated_silently(undisturbed, tmp_path):
    interrupted_in_motion(tmp_path)
    operator, lab = ScriptedOperator(), ToyLab(0)
    session = attended(tmp_path, operator, lab)
    run_iteration(session)
    assert operator.asked[0] == "repeat 2"
    assert lab.executions == [(2, 0), (3, 0), (4, 0)], "the simulated lab does the same attempt again"
    assert summary(session.store, 0)["particles"] == summary(undisturbed, 0)["particles"]


def test_on_a_real_arm_an_interrupted_trial_counts_as_a_spent_attempt(tmp_path):
    interrupted_in_motion(tmp_path)
    lab = ToyLab(0)
    session = attended(tmp_path, ScriptedOperator(), lab, name="panda")
    run_iteration(session)
    assert lab.executions == [(2, 1), (3, 0), (4, 0)]
    assert session.store.existing().rejected == {TrialKey(2, 0)}


def test_yes_never_confirms_a_real_arm(tmp_path):
    lab = ToyLab(0)
    with pytest.raises(UsageError, match="never confirms"):
        run_iteration(attended(tmp_path, unattended(), lab, name="panda"))
    assert lab.executions == []


@pytest.mark.parametrize(
    "origin",
    [
        {"checkpoint_sha256": "d" * 64},
        {"calibration_sha256": "d" * 64},
        {"camera_late_s": 0.025},
        {"world_sha256": "d" * 64},
        {"start_from_sha256": "d" * 64},
    ],
)
def test_a_session_is_continued_only_with_what_it_was_begun_with(origin, tmp_path):
    home = tmp_path / "home"
    assert call(home, RUN)[0] == 0
    lab = ToyLab(7)
    code, told = call(home, RUN, lab, **origin)
    assert code == 2
    assert "has changed since session 's' was begun" in told
    assert "Restore it, or give another --session" in told
    assert lab.executions == []


def test_a_rejected_attempt_takes_its_time_and_the_stages_add_up(tmp_path):
    session = attended(tmp_path, ScriptedOperator(reviews=[Review(), Review(rejected="touched")]))
    session.screen.lap_s()  # as a command does when everything is loaded
    began_s = time.perf_counter()
    run_iteration(session)
    took_s = time.perf_counter() - began_s
    result = session.store.result(0)
    assert 0.5 * took_s < result.timing_s[TOTAL] <= took_s + 0.05, "only the result itself is stored later"
    stages = {name: spent for name, spent in result.timing_s.items() if name != TOTAL}
    assert stages[REJECTED] > 0.0
    assert {"placing", "finding", "planning", "checking", "moving", "storing", "tracking", "other"} <= set(stages)
    assert sum(stages.values()) == pytest.approx(result.timing_s[TOTAL])


def test_what_the_tracker_notes_is_kept_and_said(tmp_path):
    flags = ("a hand is in the picture",)
    session = attended(tmp_path, unattended())
    target = rig_target(session.parts)
    noted = replace(target.tracker, track=lambda request: replace(target.tracker.track(request), flags=flags))
    parts = replace(session.parts, target=replace(target, tracker=noted))
    screen = quiet()
    run_iteration(replace(session, parts=parts, operator=Unattended(screen), screen=screen))
    assert session.store.trials(0)[0].track.flags == flags
    assert flags[0] in said(screen)


@pytest.mark.long
def test_a_step_of_adaptation_stays_inside_the_ranges(tmp_path: Path) -> None:
    store = run(tmp_path, iterations=3)
    for iteration in range(3):
        for particle in summary(store, iteration)["particles"]:
            assert PARAMETERS.contains(np.array(list(particle["next_params"].values())))


@pytest.mark.long
def test_the_same_seed_gives_the_same_numbers_and_another_seed_others(tmp_path: Path) -> None:
    def numbers(home: str, seed: int) -> object:
        store = run(tmp_path / home, seed=seed, iterations=2)
        summaries = [summary(store, i) for i in (0, 1)]
        return [(p["params"], p["next_params"], p["trials"]) for s in summaries for p in s["particles"]]

    assert numbers("a", 5) == numbers("b", 5)
    assert numbers("c", 6) != numbers("a2", 5)
