"""The motions of both tools: executable at both ends, the paper's in between, and no nearer to the table than said."""

import itertools

import numpy as np
import pytest

from sim.tasks.pushing import params as pushing
from sim.tasks.pushing import plan as push
from sim.tasks.pushing.mount import PLATE_HEIGHT_M, PLATE_THICKNESS_M, PLATE_WIDTH_M
from sim.tasks.scooping import params as scooping
from sim.tasks.scooping import plan as scoop

HERE, GOAL = np.array([0.66, 0.01]), np.array([0.85, 0.0])


def corners(params):
    ends = zip(params.ACTION.low - params.ACTION_NOISE, params.ACTION.high + params.ACTION_NOISE, strict=True)
    return [np.array(action) for action in itertools.product(*ends)]


PUSHES, SCOOPS = corners(pushing), corners(scooping)


def edge_m(motion):
    pitch_rad = np.arctan2(motion.X_BT[:, 0, 2], motion.X_BT[:, 0, 0])
    return motion.X_BT[:, 2, 3] - scoop.edge_height_m(pitch_rad)


@pytest.mark.parametrize(
    ("motion", "limits"),
    [
        *((push.plan(GOAL, action), (0.05, 1.0, 5.0, 120.0)) for action in PUSHES),
        *((scoop.plan(HERE, action), (0.1, 1.7, 13.0, 6500.0)) for action in SCOOPS),
    ],
)
def test_it_is_at_rest_with_zero_acceleration_at_both_ends_and_has_bounded_jerk(motion, limits):
    velocity = np.diff(motion.X_BT[:, :3], axis=0) * 1e3
    acceleration = np.diff(velocity, axis=0) * 1e3
    jerk = np.diff(acceleration, axis=0) * 1e3
    assert 0.9 < motion.t_s[-1] <= 1.3
    assert np.abs(velocity[[0, -1]]).max() < 1e-4
    assert np.abs(acceleration[[0, -1]]).max() < limits[0]
    for derivative, limit in zip((velocity, acceleration, jerk), limits[1:], strict=True):
        assert np.abs(derivative).max() < limit
    R = motion.X_BT[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)


@pytest.mark.parametrize("action", PUSHES)
def test_a_push_has_its_speed_before_it_touches_and_stays_on_its_line_clear_of_the_table(action):
    motion, (yaw_rad, speed_m_s) = push.plan(GOAL, action), action
    touch_s, slow_s, end_s = push.phases_s(speed_m_s)
    gone_m, beside_m = ((motion.X_BT[:, :2, 3] - pushing.START_M) @ axis for axis in _line(yaw_rad))
    speed = np.gradient(gone_m, motion.t_s)
    at_speed = (motion.t_s > touch_s - push.GAP_M / speed_m_s + 2e-3) & (motion.t_s < slow_s - 2e-3)
    np.testing.assert_allclose(speed[at_speed], speed_m_s, atol=1e-6)
    assert np.interp(touch_s, motion.t_s, gone_m) == pytest.approx(-pushing.BOTTLE_RADIUS_M, abs=1e-6)
    assert slow_s - touch_s == pytest.approx(push.HOLD_S, abs=1e-3)
    assert end_s == pytest.approx(motion.t_s[-1])
    assert gone_m[-1] - gone_m[round(slow_s * 1000)] == pytest.approx(speed_m_s * push.SLOW_S / 2, abs=2e-3)
    assert np.abs(beside_m).max() < 1e-12
    pitch = np.arctan2(motion.X_BT[:, 2, 0], motion.X_BT[:, 2, 2])
    assert np.interp(touch_s, motion.t_s, pitch) == pytest.approx(0.0, abs=1e-6), "upright when it touches"
    assert np.interp(slow_s, motion.t_s, pitch) == pytest.approx(push.HOLD_S * push.PITCH_RATE_RAD_S, abs=1e-3)
    assert -0.2 < pitch[0] < -0.1
    assert 0.3 < pitch[-1] < 0.4
    sizes = (-PLATE_THICKNESS_M, 0.0), (-PLATE_WIDTH_M / 2, PLATE_WIDTH_M / 2), (0.0, PLATE_HEIGHT_M)
    height_m = np.array([*itertools.product(*sizes)]) @ motion.X_BT[:, 2, :3].T + motion.X_BT[:, 2, 3]
    assert motion.contact is None
    assert 0.8 * push.CLEARANCE_M < height_m.min() <= push.CLEARANCE_M
    assert height_m[:, -1].min() > 0.03


def _line(yaw_rad):
    """Along the push and beside it."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([cos, sin]), np.array([-sin, cos])


def test_a_push_lifts_and_pitches_at_the_rates_of_the_paper_while_it_slows():
    motion = push.plan(GOAL, np.array([0.2, 0.6]))
    i = round((push.phases_s(0.6)[1] + 0.18) * 1000)
    rise = np.gradient(motion.X_BT[:, 2, 3], motion.t_s)
    pitch = np.gradient(np.arctan2(motion.X_BT[:, 2, 0], motion.X_BT[:, 2, 2]), motion.t_s)
    assert rise[i] == pytest.approx(push.RISE_M_S, rel=1e-6)
    assert pitch[i] == pytest.approx(push.PITCH_RATE_RAD_S, rel=1e-6)


@pytest.mark.parametrize("action", SCOOPS)
def test_a_scoop_commands_no_more_depth_than_the_window_says_and_only_inside_it(action):
    motion = scoop.plan(HERE, action)
    height_m, window = edge_m(motion), motion.contact
    assert window is not None
    assert 0.0 < window.depth_m <= scoop.DEPTH_LIMIT_M
    np.testing.assert_allclose(-height_m.min(), window.depth_m, atol=1e-12)
    outside = (motion.t_s < window.start_s) | (motion.t_s > window.end_s)
    assert (height_m[outside] > 0.0).all()
    assert 0.99 * scoop.VERTICAL_STIFFNESS_N_M * window.depth_m <= window.force_N < 20.0


def test_a_scoop_ends_with_the_edge_lifted_and_a_late_pitch_lifts_it_later():
    early, late = (scoop.plan(HERE, np.array([rate, 0.1, 0.01])) for rate in (-0.2, 0.2))
    assert edge_m(early)[-1] > 0.03
    assert edge_m(late)[-1] > 0.025
    assert early.contact.end_s + 0.1 < late.contact.end_s


def test_above_the_table_the_wrist_moves_as_the_paper_says():
    motion = scoop.plan(HERE, np.array([-0.2, 0.1, 0.01]))
    wrist_m = motion.X_BT[:, :3, 3] + motion.X_BT[:, :3, :3] @ scooping.WRIST_IN_TOOL_M
    velocity = np.gradient(wrist_m, motion.t_s, axis=0)
    for t_s, forward_m_s, up_m_s in ((0.35, 0.7, -0.01), (0.60, 0.2, 0.01), (0.70, 0.0, 0.0)):
        np.testing.assert_allclose(velocity[round(t_s * 1000), [0, 2]], [forward_m_s, up_m_s], atol=2e-3)


def test_a_scoop_starts_behind_the_near_side_as_far_as_the_action_says_and_moves_along_with_it():
    action = np.array([0.0, 0.1, 0.012])
    here, there = scoop.plan(HERE, action), scoop.plan(scooping.CONTEXT.high, action)
    np.testing.assert_allclose(here.X_BT[0, :2, 3], [HERE[0] - 0.012, HERE[1]])
    shift_m = there.X_BT[:, :3, 3] - here.X_BT[:, :3, 3]
    np.testing.assert_allclose(shift_m, np.tile([*(scooping.CONTEXT.high - HERE), 0.0], (len(shift_m), 1)), atol=1e-12)
