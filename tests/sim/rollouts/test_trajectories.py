"""Trajectories that no object on a table can have are named with numbers; simulated ones pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.types import ObjectTrack, Outcome
from sim.rollouts.trajectories import contradiction, drifts
from sim.tasks import get_task

PUSHING = get_task("pushing")
ACTION = np.array([0.15, 0.72])
MIDDLE = [space.denormalise(np.full(len(space), 0.5)) for space in (PUSHING.parameters, PUSHING.nuisance)]


@pytest.fixture(scope="module")
def push() -> ObjectTrack:
    track = PUSHING.simulate(MIDDLE[0], PUSHING.reference_context, ACTION, MIDDLE[1])
    t_s = np.arange(0.0, track.t_s[-1] + 0.4, 1 / 30)
    return replace(track, t_s=t_s, state=track.at(t_s), confidence=np.ones(len(t_s)))


def sentence(track: ObjectTrack) -> str:
    return contradiction(PUSHING, track, None, ACTION)


def test_a_simulated_push_passes(push: ObjectTrack) -> None:
    assert sentence(push) == ""
    assert drifts(PUSHING, [push] * 8) == ""


def test_one_sample_off_the_way_is_named(push: ObjectTrack) -> None:
    state = np.array(push.state)
    state[12, 0] += 0.3
    assert "mm off its way" in sentence(replace(push, state=state))


def test_places_that_are_repeated_between_measurements_are_named(push: ObjectTrack) -> None:
    """A tracker at 5 Hz, written down at 30 Hz: the object seems to lag behind by up to 0.2 s."""

    def held(count: int) -> ObjectTrack:
        return replace(push, state=push.state[(np.arange(len(push.t_s)) // count) * count])

    assert "its place is new only every 0.2 s while the object moves" in sentence(held(6))
    assert sentence(held(1)) == ""
    for resolution_m in (0.001, 0.02):
        rounded = replace(push, state=np.round(push.state / resolution_m) * resolution_m)
        assert sentence(rounded) == "", "a coarse resolution repeats places too"


def test_a_tracker_that_stops_while_the_object_moves_is_named(push: ObjectTrack) -> None:
    speed_m_s = np.linalg.norm(np.diff(push.state[:, :2], axis=0), axis=1) * 30
    fastest = int(speed_m_s.argmax())
    state = np.array(push.state)
    state[fastest + 1 :] = state[fastest + 1]
    stopped = replace(push, state=state)
    assert f"until {push.t_s[fastest + 1]:.3g} s, and from then on its place is the same" in sentence(stopped)
    fell = replace(stopped, outcome=Outcome.TIPPED)
    assert "same to the last digit" not in sentence(fell), "a fallen bottle counts as staying where it fell"


@pytest.mark.long  # four rollouts
def test_an_object_that_is_carried_away_after_its_rest_is_named(push: ObjectTrack) -> None:
    rest, home = push.state[-1], push.state[0]
    carried = [rest + share * (home - rest) for share in np.linspace(0.0, 1.0, 30)]
    state = np.vstack([push.state, np.repeat(rest[None], 30, axis=0), carried])
    t_s = np.arange(len(state)) / 30
    track = replace(push, t_s=t_s, state=state, confidence=np.ones(len(t_s)))
    assert "comes to rest at" in sentence(track)
    assert "moves again" in sentence(track)


@pytest.mark.long  # four rollouts
def test_an_object_that_never_moves_under_a_push_is_named(push: ObjectTrack) -> None:
    frozen = replace(push, state=np.repeat(push.state[:1], len(push.t_s), axis=0))
    assert "the object never moves" in sentence(frozen)
    assert "simulations" in sentence(frozen)


def test_a_height_of_another_frame_is_named(push: ObjectTrack) -> None:
    assert "height is 1.0" in sentence(replace(push, state=push.state + np.array([0.0, 0.0, 1.0])))


def test_a_drift_that_all_trials_share_is_named(push: ObjectTrack) -> None:
    drifting = replace(push, state=push.state + np.outer(push.t_s, [0.02, 0.0, 0.0]))
    assert "creeps by 20 mm/s" in drifts(PUSHING, [drifting] * 8)


def test_a_task_of_angles_is_left_alone() -> None:
    pendulum = get_task("pendulum")
    still = ObjectTrack(np.arange(9) / 10, np.zeros((9, 5)), Outcome.SETTLED, np.zeros(3), np.ones(9))
    assert contradiction(pendulum, still, None, np.zeros(8)) == ""
