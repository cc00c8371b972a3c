"""Recorded trials that contradict their own commands: the reading that fits them is named, and sound ones pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import recordings

from adaptsim_cli.bench.checkpoints import usual_checkpoint
from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.checkpoint import load_checkpoint
from sim.rollouts.recorded import RecordedTrials
from sim.solvers.readings import doubt, table_doubt, trial_doubt
from sim.tasks import get_task
from sim.tasks.pendulum import TASK
from sim.tasks.pendulum.solver import LqrSolver

SOLVER = LqrSolver(TASK)
ACTIONS, TRACKS = recordings(10)


def swings(signs: tuple[float, ...] = (1.0,) * 5, *, shifted: int = 0) -> RecordedTrials:
    tracks = [replace(track, state=track.state * signs) for track in TRACKS]
    names = tuple(map(str, range(len(tracks))))
    return RecordedTrials(TASK, names, None, ACTIONS, tuple(tracks[shifted:] + tracks[:shifted]))


def test_sound_trials_pass() -> None:
    assert doubt(SOLVER, swings()) == ""


def test_an_angle_of_the_other_sign_is_named() -> None:
    assert "if q2 [rad] has the other sign, and 0 of 10" in doubt(SOLVER, swings((1.0, -1.0, 1.0, 1.0, 1.0)))


def test_trajectories_of_the_next_trial_are_named() -> None:
    assert "each trajectory belongs to the trial after it" in doubt(SOLVER, swings(shifted=1))


def pushes(place: float = 0.35, count: int = 10) -> RecordedTrials:
    """Expected pushes of the emulator as trajectories, at a place of the parameters' ranges."""
    task = get_task("pushing")
    actions = task.action.sample(np.random.default_rng(3), count)
    solver = load_checkpoint(task, usual_checkpoint(task)).solver
    parameters = np.repeat(task.parameters.denormalise(np.full((1, len(task.parameters)), place)), count, axis=0)
    nuisance = np.repeat(task.nuisance.denormalise(np.full((1, len(task.nuisance)), 0.5)), count, axis=0)
    paths = task.observation.denormalise(solver.trajectories(parameters, actions, nuisance))
    t_s = np.r_[0.0, task.observation.times_s, task.observation.times_s[-1] + 0.2]
    tracks = []
    for path in paths:
        places = np.vstack([task.require_hardware().standing.mark_m, path, path[-1:]])
        state = np.c_[places, np.full(len(t_s), 0.05)]
        tracks.append(ObjectTrack(t_s, state, task.require_report().outcomes[0], np.full(3, np.nan), np.ones(len(t_s))))
    return RecordedTrials(task, tuple(map(str, range(count))), None, actions, tuple(tracks))


def changed(trials: RecordedTrials, times: float = 1.0, R: Array | None = None) -> RecordedTrials:
    """The same pushes with other times, and with their ways from the start turned by R (2, 2)."""
    tracks = []
    for track in trials.tracks:
        state = np.array(track.state)
        state[:, :2] = state[0, :2] + (state[:, :2] - state[0, :2]) @ (np.eye(2) if R is None else R).T
        tracks.append(replace(track, t_s=track.t_s * times, state=state))
    return replace(trials, tracks=tuple(tracks))


@pytest.mark.parametrize(
    ("times", "R", "words"),
    [
        (1.0, None, ""),
        (1.0, np.diag([1.0, -1.0]), "if y (or the action across) is flipped"),
        (1.0, np.array([[0.0, -1.0], [1.0, 0.0]]), "if the states are turned by -90° about z"),
        (0.5, None, "if the times are multiplied by 2"),
    ],
    ids=["sound", "flipped", "turned", "half of the times"],
)
def test_pushes_in_another_frame_or_at_another_rate_are_named(times: float, R: Array | None, words: str) -> None:
    trials = changed(pushes(), times, R)
    sentence = doubt(load_checkpoint(trials.task, usual_checkpoint(trials.task)).solver, trials)
    assert words in sentence
    assert bool(sentence) == bool(words)


def test_only_the_trials_that_are_wrong_are_named() -> None:
    sound = pushes()
    solver = load_checkpoint(sound.task, usual_checkpoint(sound.task)).solver
    turned = changed(sound, R=np.array([[0.0, -1.0], [1.0, 0.0]])).tracks
    some = replace(sound, tracks=(*sound.tracks[:3], turned[3], *sound.tracks[4:7], turned[7], *sound.tracks[8:]))
    assert table_doubt(solver, some) == ""
    assert "fits 2 of 10 trials (3, 7) only if the states are turned by -90° about z" in doubt(solver, some)


def test_one_trial_alone_is_compared_with_its_action() -> None:
    sound = pushes()
    solver = load_checkpoint(sound.task, usual_checkpoint(sound.task)).solver
    one = np.array([4])
    assert trial_doubt(solver, sound.some(one)) == ""
    fast = changed(sound, times=0.5).some(one)
    assert "fits trial 4 only if the times are multiplied by 2 (misfit" in trial_doubt(solver, fast)
