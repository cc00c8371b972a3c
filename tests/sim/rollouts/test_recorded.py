"""FromRecordings trials are checked once, split by seed, and shuffled for the control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import recordings

from sim.errors import RecordingsRefused
from sim.research.benchmark.trial_sources import FromRecordings
from sim.rollouts.recorded import LEAST, RecordedTrials, frame_aside, require_sound, scores_only
from sim.tasks import get_task
from sim.tasks.pendulum import TASK

ACTIONS, TRACKS = recordings(16)


def trials(n: int = 16) -> RecordedTrials:
    return RecordedTrials(TASK, tuple(map(str, range(n))), None, ACTIONS[:n], tuple(TRACKS[:n]))


def test_the_same_seed_splits_alike_and_no_trial_is_on_both_sides() -> None:
    (shown, held), (again, _) = trials().split(0.5, 3), trials().split(0.5, 3)
    assert shown.names == again.names
    assert shown.names != trials().split(0.5, 4)[0].names
    assert sorted((*shown.names, *held.names), key=int) == list(trials().names)
    assert len(held) == 8


def test_a_control_keeps_actions_and_outcomes_but_not_their_pairs() -> None:
    mixed = trials().permuted(0)
    assert np.array_equal(mixed.actions, ACTIONS)
    moved = [one is not other for one, other in zip(mixed.tracks, TRACKS, strict=True)]
    assert sum(moved) > 10
    assert {id(track) for track in mixed.tracks} == {id(track) for track in TRACKS}


def test_a_place_of_recordings_gives_each_once_and_scores_by_the_others() -> None:
    shown, held = trials().split(0.5, 0)
    place, nowhere, rng = FromRecordings(shown, held), np.zeros((1, 0)), np.random.default_rng(0)
    action = shown.actions[2]
    assert place.executable(nowhere[0], action)
    place.take(action)
    assert not place.executable(nowhere[0], action)
    assert not place.executable(nowhere[0], held.actions[0])
    assert place.play(nowhere, action[None], rng)[0].reward == TASK.score(shown.tracks[2], nowhere[0])
    assert place.score(nowhere, held.actions[:1], rng)[0] == TASK.score(held.tracks[0], nowhere[0])
    best = place.score(nowhere, place.best_actions(nowhere), rng)[0]
    assert best == max(TASK.score(track, nowhere[0]) for track in held.tracks)


def test_hostile_trials_are_refused_with_the_reason() -> None:
    def refused(match: str, **changes: object) -> None:
        with pytest.raises(RecordingsRefused, match=match):
            replace(trials(), **changes)  # type: ignore[arg-type]

    high = ACTIONS.copy()
    high[4, 0] = 1e4
    refused("trial 4: action: k11 .* = 1e[+]04 lies outside of .*units", actions=high)
    twin = ACTIONS.copy()
    twin[7] = twin[3]
    refused("trials 3 and 7 have the same action", actions=twin)
    refused("trial 0 is there twice", names=("0", *trials().names[1:-1], "0"))
    late = replace(TRACKS[0], t_s=TRACKS[0].t_s[::-1] - TRACKS[0].t_s[-1])
    refused("trial 0: its times must increase", tracks=(late, *TRACKS[1:]))
    narrow = replace(TRACKS[0], state=TRACKS[0].state[:, :1])
    refused("needs 2 columns, and has 1", tracks=(narrow, *TRACKS[1:]))
    refused("16 trials and 15 trajectories", tracks=tuple(TRACKS[:15]))
    with pytest.raises(RecordingsRefused, match=f"there are 7 .* at least {LEAST}"):
        require_sound(trials(7))
    with pytest.raises(RecordingsRefused, match="2 are left to be held out, and 4 are needed"):
        trials(10).split(0.2, 0)


def test_a_context_that_changes_the_motion_must_be_recorded() -> None:
    assert scores_only(get_task("pushing"))
    assert not scores_only(get_task("scooping"))
    with pytest.raises(RecordingsRefused, match=r"context .* is missing"):
        RecordedTrials(get_task("scooping"), (), None, np.zeros((0, 3)), ())


def test_a_trajectory_under_two_actions_is_a_copy() -> None:
    with pytest.raises(RecordingsRefused, match=r"trials 2 and 9 have the same trajectory, to the last digit"):
        replace(trials(), tracks=(*TRACKS[:9], TRACKS[2], *TRACKS[10:16]))
    noise = np.random.default_rng(5).normal(0.0, 1e-6, TRACKS[2].state.shape)
    nearly = replace(TRACKS[2], state=TRACKS[2].state + noise)
    with pytest.raises(RecordingsRefused, match=r"trials 2 and 9 have the same trajectory, within 0\.01% of the range"):
        require_sound(replace(trials(), tracks=(*TRACKS[:9], nearly, *TRACKS[10:16])))
    resting = [replace(track, state=np.repeat(track.state[:1], len(track.t_s), axis=0)) for track in TRACKS[:4]]
    assert len(replace(trials(), tracks=(*resting, *TRACKS[4:16]))) == 16, "objects that stay are no copies"


def test_starts_that_all_lie_aside_by_the_same_way_are_those_of_another_frame() -> None:
    rng = np.random.default_rng(0)
    by_hand = [rng.normal(0.0, 0.012, 2) for _ in range(12)]
    assert frame_aside(by_hand) == ""
    assert frame_aside([None] * 12) == ""
    aside = [np.array([0.0, 0.09]) + offset for offset in by_hand]
    assert frame_aside(aside[:2]) == "", "two starts may lie so by chance"
    assert "in 12 trials the object begins 8" in frame_aside(aside) or "begins 9" in frame_aside(aside)
    scattered = [np.array([0.05, 0.0]), np.array([-0.05, 0.0]), np.array([0.0, 0.05]), np.array([0.0, 0.06])]
    assert frame_aside(scattered) == ""
