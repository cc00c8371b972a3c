"""Rewards, spaces and effects of a world: what is allowed and what it is worth."""

import numpy as np
import pytest

from sim.errors import OutOfRange
from sim.lab.world import list_worlds, load_world
from sim.tasks.pushing import TASK
from sim.tasks.pushing.params import ACTION_NOISE, NUISANCE, Unmodelled, goal_m
from sim.tasks.pushing.rollout import reward_of_success
from sim.tasks.pushing.scene import sink_m


def test_a_bottle_at_the_goal_earns_1_and_20_cm_from_it_nothing():
    contexts = TASK.context.sample(np.random.default_rng(0), 20)
    goals = goal_m(contexts)
    np.testing.assert_allclose(reward_of_success(goals, contexts), 1.0)
    np.testing.assert_allclose(reward_of_success(goals + np.array([0.0, 0.1]), contexts), 0.5)
    np.testing.assert_allclose(reward_of_success(goals + np.array([0.2, 0.01]), contexts), 0.0)


def test_wherever_the_bottle_may_be_placed_it_passes_the_check_of_5_mm():
    assert np.hypot(*NUISANCE.high) < 0.005
    assert np.hypot(*NUISANCE.low) < 0.005


def test_observations_of_many_relocate_together():
    observations, contexts = np.zeros((7, 12)), np.zeros((7, 2))
    assert TASK.relocate(observations, contexts).shape == (7, 12)
    assert TASK.relocate(observations[0], contexts).shape == (7, 12)


def test_the_margin_holds_every_target_and_the_executed_actions_stay_small():
    for name in ("wd", "ood-1", "ood-2", "ood-3", "ood-4"):
        TASK.margin.check(load_world(name, TASK).parameters, name)
    assert (ACTION_NOISE / (TASK.action.high - TASK.action.low)).max() < 0.05


def test_every_shipped_world_loads():
    names = list_worlds(TASK)
    assert {"heavy-bottle", "light-bottle", "half-full", "tilted-table", "worn-patch"} <= set(names)
    for name in names:
        assert load_world(name, TASK).description


def test_the_hard_base_sinks_in_as_far_as_its_weight_asks():
    depth_m = sink_m(0.3)
    assert np.pi * 0.028**2 * 1e7 * depth_m / 0.01 == pytest.approx(0.3 * 9.81)  # pressure e depth / (h / 2)
    assert depth_m < 1e-5


@pytest.mark.parametrize(
    ("effect", "why"),
    [
        ({"bottle_mass_scale": 0.0}, "positive"),
        ({"dt_s": -0.001}, "positive"),
        ({"com_height_m": 0.11}, "of the bottle"),
        ({"slosh_share": 1.0}, "slosh_share"),
        ({"table_tilt_rad": (0.0, 0.5)}, "steeper"),
        ({"contact": "penalty"}, 'must be "sap" or "lagged"'),
    ],
)
def test_impossible_effects_are_refused(effect, why):
    with pytest.raises(OutOfRange, match=why):
        Unmodelled(**effect)
