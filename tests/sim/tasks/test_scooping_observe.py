"""Reward, observation and the world's effects of scooping."""

import numpy as np
import pytest

from perception.types import ObjectTrack, Outcome
from sim.errors import OutOfRange, UnknownName
from sim.tasks import TASKS, get_task
from sim.tasks.scooping import TASK
from sim.tasks.scooping.params import REFERENCE_CONTEXT, Unmodelled


def track(outcome, end_m):
    return ObjectTrack(np.array([0.0, 1.0]), np.zeros((2, 3)), outcome, np.array(end_m), np.ones(2))


@pytest.mark.parametrize(
    ("outcome", "end_m", "reward"),
    [
        (Outcome.ON_BLADE, (-0.05, 0.0, 0.01), 1.0),
        (Outcome.ON_BLADE, (-0.05, 0.025, 0.01), 0.9),
        (Outcome.ON_BLADE, (0.0, 0.04, 0.01), 0.8),
        (Outcome.ON_TABLE, (-0.05, 0.0, 0.01), 0.0),
        (Outcome.LOST, (-0.05, 0.0, 0.01), 0.0),
        (Outcome.SOLVER_FAILED, (-0.05, 0.0, 0.01), 0.0),
    ],
)
def test_reward_is_that_of_the_public_code(outcome, end_m, reward):
    assert TASK.score(track(outcome, end_m), REFERENCE_CONTEXT) == pytest.approx(reward)


def test_observation_has_sixteen_numbers_and_moves_with_the_piece():
    here = TASK.observation.normalise(np.tile([0.7, 0.01], (8, 1)))
    assert here.shape == (16,)
    there = TASK.observation.denormalise(TASK.relocate(here, REFERENCE_CONTEXT + np.array([0.01, -0.02])))
    np.testing.assert_allclose(there, np.tile([0.71, -0.01], (8, 1)))


def test_friction_of_the_blade_gives_the_pair_its_share():
    mu, effects = 0.3, Unmodelled(second_friction_scale=0.7)
    blade = effects.friction_of_blade(mu)
    assert 2 * mu * blade / (mu + blade) == pytest.approx(0.7 * mu)
    assert Unmodelled().friction_of_blade(mu) == pytest.approx(mu)


@pytest.mark.parametrize(
    ("effects", "name"),
    [
        ({"semi_axis_scale": (1.0, 0.0)}, "semi_axis_scale"),
        ({"density_scale": -1.0}, "density_scale"),
        ({"second_friction_scale": 2.0}, "second_friction_scale"),
        ({"blade_flex_rad": -0.01}, "blade_flex_rad"),
        ({"contact": "sticky"}, "contact"),
        ({"dt_s": 0.0}, "dt_s"),
    ],
)
def test_impossible_effects_are_refused_by_name(effects, name):
    with pytest.raises(OutOfRange, match=name):
        Unmodelled(**effects)


def test_tasks_are_found_by_name_and_an_unknown_one_lists_what_there_is():
    assert all(get_task(name).name == name for name in TASKS)
    with pytest.raises(UnknownName, match=r"juggling.*scooping"):
        get_task("juggling")
