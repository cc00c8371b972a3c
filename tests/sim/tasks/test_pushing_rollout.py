"""Rollouts in Drake: they repeat exactly, end as they should, and never raise."""

import numpy as np
import pytest

from perception.types import REST_M_S, Outcome
from sim.tasks.pushing import TASK
from sim.tasks.pushing.params import START_M, Unmodelled
from sim.tasks.pushing.plan import plan
from sim.tasks.shared import direct

NOMINAL = np.array([0.12, 2e5, 0.4, 0.05])  # mu, e, mu_p, y_p
STRAIGHT = np.array([0.0, 0.6])
GOAL = np.array([0.85, 0.0])
IN_PLACE = np.zeros(2)


def push(parameters=NOMINAL, action=STRAIGHT, placed=IN_PLACE, effects=None, goal=GOAL):
    return TASK.simulate(parameters, goal, action, placed, effects)


@pytest.fixture(scope="module")
def pushed():
    return push()


def test_a_push_moves_the_bottle_ahead_and_it_stays_upright(pushed):
    assert pushed.outcome is Outcome.UPRIGHT
    assert pushed.t_s[0] == 0.0
    np.testing.assert_allclose(pushed.state[0, :2], START_M)
    assert 0.70 < pushed.state[-1, 0] < 1.0
    assert abs(pushed.state[-1, 1]) < 0.03
    assert 0.0 < TASK.score(pushed, GOAL) < 1.0


def test_it_is_recorded_until_the_bottle_rests(pushed):
    speed_m_s = np.linalg.norm(pushed.state[-1] - pushed.state[-2]) / (pushed.t_s[-1] - pushed.t_s[-2])
    assert speed_m_s < 20 * REST_M_S
    slippery = push(np.array([0.05, 2e5, 0.2, 0.3]), np.array([0.0, 0.65]))
    assert slippery.t_s[-1] > 1.3
    assert np.hypot(*(slippery.state[-1] - slippery.at(np.array([1.3]))[0])[:2]) > 0.005


def test_nothing_happens_before_the_plate_touches(pushed):
    np.testing.assert_allclose(pushed.state[1], pushed.state[0], atol=2e-4)
    assert pushed.t_s[1] > 0.1


def test_the_same_push_repeats_exactly(pushed):
    again = push()
    np.testing.assert_array_equal(again.state, pushed.state)
    np.testing.assert_array_equal(again.end_in_tool_m, pushed.end_in_tool_m)


def test_the_goal_moves_nothing_but_the_reward(pushed):
    elsewhere = np.array([0.95, 0.1])
    np.testing.assert_array_equal(push(goal=elsewhere).state, pushed.state)
    observation = TASK.observation(pushed)
    np.testing.assert_array_equal(TASK.relocate(observation, elsewhere), observation)
    assert TASK.score(pushed, elsewhere) != TASK.score(pushed, GOAL)


def test_yaw_turns_the_push_about_the_start():
    left, right = (push(np.array([0.12, 2e5, 0.4, 0.4]), np.array([yaw, 0.5])) for yaw in (0.2, -0.2))
    moved_m = left.state[-1, :2] - START_M
    assert np.arctan2(moved_m[1], moved_m[0]) == pytest.approx(0.2, abs=0.03)
    np.testing.assert_allclose(right.state[-1, :2], left.state[-1, :2] * [1.0, -1.0], atol=0.015)


def test_a_rough_patch_in_the_way_throws_a_top_heavy_bottle_over():
    parameters, action = np.array([0.06, 1e5, 0.9, 0.0]), np.array([0.0, 0.6])
    tall = Unmodelled(com_height_m=0.08)
    assert TASK.simulate(parameters, GOAL, action, np.zeros(2), tall).outcome is Outcome.TIPPED
    assert TASK.simulate(parameters, GOAL, action, np.zeros(2)).outcome is Outcome.UPRIGHT


def test_a_bottle_that_nothing_brakes_leaves_the_table():
    away = push(np.array([0.005, 1e6, 0.005, 0.0]), np.array([0.0, 0.8]))
    assert away.outcome is Outcome.LOST
    assert TASK.score(away, GOAL) == 0.0


def test_a_misplaced_bottle_starts_where_it_was_placed():
    placed = np.array([0.003, -0.002])
    np.testing.assert_allclose(push(placed=placed).state[0, :2], START_M + placed)


@pytest.mark.parametrize(
    "effects",
    [
        Unmodelled(bottle_mass_scale=1.5),
        Unmodelled(com_height_m=0.03),
        Unmodelled(slosh_share=0.4),
        Unmodelled(patch_size_scale=2.0),
        Unmodelled(table_tilt_rad=(0.02, 0.0)),
        Unmodelled(plate_restitution_scale=10.0),
        Unmodelled(contact="sap"),
        Unmodelled(dt_s=0.00125),
    ],
)
def test_every_effect_of_a_world_changes_what_happens(effects, pushed):
    changed = push(effects=effects)
    assert changed.outcome is not Outcome.SOLVER_FAILED
    assert not np.array_equal(changed.state[-1], pushed.state[-1])


def test_a_solver_that_gives_up_is_an_outcome_with_a_reason(monkeypatch):
    class Stuck(direct.Simulator):  # type: ignore[misc, name-defined]
        def AdvanceTo(self, boundary_time):
            if boundary_time > 0.4:
                raise RuntimeError("did not converge")
            return super().AdvanceTo(boundary_time)

    monkeypatch.setattr(direct, "Simulator", Stuck)
    failed = push()
    assert failed.outcome is Outcome.SOLVER_FAILED
    assert "did not converge" in failed.flags[0]
    assert TASK.score(failed, GOAL) == 0.0


def test_the_tool_follows_the_plan(pushed):
    """Where the bottle ends in the tool frame tells where the carriage is: the end of the planned motion, or on its way
    there when the bottle rested earlier."""
    X_BT = plan(GOAL, STRAIGHT).X_BT
    p_BT_m = pushed.state[-1] - X_BT[-1, :3, :3] @ pushed.end_in_tool_m
    assert np.abs(p_BT_m - X_BT[:, :3, 3]).sum(axis=1).min() < 0.02
