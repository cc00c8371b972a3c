"""The motion of the pusher: at speed before it touches, clear of the table, at rest at both ends."""

import itertools

import numpy as np
import pytest

from sim.tasks.pushing.mount import PLATE_HEIGHT_M, PLATE_THICKNESS_M, PLATE_WIDTH_M
from sim.tasks.pushing.params import ACTION, ACTION_NOISE, BOTTLE_RADIUS_M, CONTEXT, MARGIN, PARAMETERS, START_M, goal_m
from sim.tasks.pushing.plan import CLEARANCE_M, GAP_M, HOLD_S, PITCH_RATE_RAD_S, RISE_M_S, SLOW_S, phases_s, plan

CORNERS = [
    np.array(a) for a in itertools.product(*zip(ACTION.low - ACTION_NOISE, ACTION.high + ACTION_NOISE, strict=True))
]
GOAL = np.array([0.85, 0.0])


def along_m(motion, yaw_rad):
    """Of the lower edge, from the bottle's start, along the line of the push."""
    return (motion.X_BT[:, :2, 3] - START_M) @ [np.cos(yaw_rad), np.sin(yaw_rad)]


@pytest.mark.parametrize("action", CORNERS)
def test_is_at_rest_with_zero_acceleration_at_both_ends_and_has_bounded_jerk(action):
    motion = plan(GOAL, action)
    velocity = np.diff(motion.X_BT[:, :3], axis=0) * 1e3
    acceleration = np.diff(velocity, axis=0) * 1e3
    jerk = np.diff(acceleration, axis=0) * 1e3
    assert 0.9 < motion.t_s[-1] <= 1.3
    assert np.abs(velocity[[0, -1]]).max() < 1e-4
    assert np.abs(acceleration[[0, -1]]).max() < 0.05
    assert np.abs(acceleration).max() < 5.0
    assert np.abs(jerk).max() < 120.0


@pytest.mark.parametrize("action", CORNERS)
def test_has_its_speed_before_it_touches_and_holds_it(action):
    motion = plan(GOAL, action)
    yaw_rad, speed_m_s = action
    touch_s, slow_s, end_s = phases_s(speed_m_s)
    gone_m = along_m(motion, yaw_rad)
    speed = np.gradient(gone_m, motion.t_s)
    at_speed = (motion.t_s > touch_s - GAP_M / speed_m_s + 2e-3) & (motion.t_s < slow_s - 2e-3)
    np.testing.assert_allclose(speed[at_speed], speed_m_s, atol=1e-6)
    touching = np.interp(touch_s, motion.t_s, gone_m)
    assert touching == pytest.approx(-BOTTLE_RADIUS_M, abs=1e-6)
    assert slow_s - touch_s == pytest.approx(HOLD_S, abs=1e-3)
    assert end_s == pytest.approx(motion.t_s[-1])
    assert gone_m[-1] - gone_m[round(slow_s * 1000)] == pytest.approx(speed_m_s * SLOW_S / 2, abs=2e-3)


@pytest.mark.parametrize("action", CORNERS)
def test_stays_on_the_line_through_the_bottle_and_is_upright_when_it_touches(action):
    motion = plan(GOAL, action)
    yaw_rad = action[0]
    beside_m = (motion.X_BT[:, :2, 3] - START_M) @ [-np.sin(yaw_rad), np.cos(yaw_rad)]
    assert np.abs(beside_m).max() < 1e-12
    touch_s, slow_s, _ = phases_s(action[1])
    pitch = np.arctan2(motion.X_BT[:, 2, 0], motion.X_BT[:, 2, 2])
    assert np.interp(touch_s, motion.t_s, pitch) == pytest.approx(0.0, abs=1e-6)
    assert np.interp(slow_s, motion.t_s, pitch) == pytest.approx(HOLD_S * PITCH_RATE_RAD_S, abs=1e-3)
    assert -0.2 < pitch[0] < -0.1
    assert 0.3 < pitch[-1] < 0.4
    R = motion.X_BT[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)


@pytest.mark.parametrize("action", CORNERS)
def test_no_part_of_the_plate_comes_near_the_table(action):
    motion = plan(GOAL, action)
    corners_T_m = np.array(
        list(
            itertools.product((-PLATE_THICKNESS_M, 0.0), (-PLATE_WIDTH_M / 2, PLATE_WIDTH_M / 2), (0.0, PLATE_HEIGHT_M))
        )
    )
    height_m = (corners_T_m @ motion.X_BT[:, 2, :3].T) + motion.X_BT[:, 2, 3]
    assert motion.contact is None
    assert 0.8 * CLEARANCE_M < height_m.min() <= CLEARANCE_M
    assert height_m[:, -1].min() > 0.03


def test_lifts_and_pitches_at_the_rates_of_the_paper_while_it_slows():
    motion = plan(GOAL, np.array([0.2, 0.6]))
    i = round((phases_s(0.6)[1] + 0.18) * 1000)
    rise = np.gradient(motion.X_BT[:, 2, 3], motion.t_s)
    pitch = np.gradient(np.arctan2(motion.X_BT[:, 2, 0], motion.X_BT[:, 2, 2]), motion.t_s)
    assert rise[i] == pytest.approx(RISE_M_S, rel=1e-6)
    assert pitch[i] == pytest.approx(PITCH_RATE_RAD_S, rel=1e-6)


def test_the_goal_does_not_enter_the_motion():
    action = np.array([0.1, 0.5])
    assert np.array_equal(plan(CONTEXT.low, action).X_BT, plan(CONTEXT.high, action).X_BT)


def test_ranges_are_those_of_the_paper():
    """Table A2 and A4.1."""
    np.testing.assert_allclose(PARAMETERS.low, [0.05, 1e4, 0.2, -0.1])
    np.testing.assert_allclose(PARAMETERS.high, [0.20, 1e6, 0.8, 0.1])
    np.testing.assert_allclose([*ACTION.low, *ACTION.high], [-0.3, 0.4, 0.3, 0.8])
    targets = [(0.1, 1e5, 0.6, 0.05), (0.25, 5e4, 0.1, -0.1), (0.05, 1e5, 0.9, 0.05), (0.15, 5e6, 0.1, -0.15)]
    assert all(MARGIN.contains(np.array(target)) for target in [*targets, (0.30, 1e5, 0.15, 0.1)])


def test_goals_fill_the_wedge_in_front_of_the_bottle():
    goals_m = goal_m(CONTEXT.denormalise(np.array(list(itertools.product((0.0, 0.5, 1.0), repeat=2)))))
    assert goals_m[:, 0].min() == pytest.approx(0.7)
    assert goals_m[:, 0].max() == pytest.approx(1.0)
    seen = np.arctan2(goals_m[:, 1] - START_M[1], goals_m[:, 0] - START_M[0])
    assert np.abs(np.rad2deg(seen)).max() == pytest.approx(10.0)
    assert np.abs(goals_m[:, 1]).max() == pytest.approx(0.0776, abs=1e-4)
