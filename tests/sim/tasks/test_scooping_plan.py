"""The motion: the paper's where it is above the table, gentle where it is below, executable at both ends."""

import itertools

import numpy as np
import pytest

from sim.tasks.scooping.params import ACTION, ACTION_NOISE, CONTEXT, WRIST_IN_TOOL_M
from sim.tasks.scooping.plan import DEPTH_LIMIT_M, DURATION_S, VERTICAL_STIFFNESS_N_M, edge_height_m, plan

CORNERS = [
    np.array(a) for a in itertools.product(*zip(ACTION.low - ACTION_NOISE, ACTION.high + ACTION_NOISE, strict=True))
]
HERE = np.array([0.66, 0.01])


def edge_m(motion):
    pitch_rad = np.arctan2(motion.X_BT[:, 0, 2], motion.X_BT[:, 0, 0])
    return motion.X_BT[:, 2, 3] - edge_height_m(pitch_rad)


@pytest.mark.parametrize("action", CORNERS)
def test_is_at_rest_with_zero_acceleration_at_both_ends_and_has_bounded_jerk(action):
    motion = plan(HERE, action)
    p_m = motion.X_BT[:, :3, 3]
    velocity = np.diff(p_m, axis=0) * 1e3
    acceleration = np.diff(velocity, axis=0) * 1e3
    jerk = np.diff(acceleration, axis=0) * 1e3
    assert motion.t_s[-1] == DURATION_S
    assert np.abs(velocity[[0, -1]]).max() < 1e-4
    assert np.abs(acceleration[[0, -1]]).max() < 0.1
    assert np.abs(velocity).max() < 1.7
    assert np.abs(acceleration).max() < 13.0
    assert np.abs(jerk).max() < 6500.0


@pytest.mark.parametrize("action", CORNERS)
def test_commands_no_more_depth_than_the_window_says_and_only_inside_it(action):
    motion = plan(HERE, action)
    height_m = edge_m(motion)
    assert motion.contact is not None
    assert 0.0 < motion.contact.depth_m <= DEPTH_LIMIT_M
    np.testing.assert_allclose(-height_m.min(), motion.contact.depth_m, atol=1e-12)
    outside = (motion.t_s < motion.contact.start_s) | (motion.t_s > motion.contact.end_s)
    assert (height_m[outside] > 0.0).all()
    assert motion.contact.force_N >= 0.99 * VERTICAL_STIFFNESS_N_M * motion.contact.depth_m
    assert motion.contact.force_N < 20.0


def test_ends_with_the_edge_lifted_and_a_late_pitch_lifts_it_later():
    early, late = (plan(HERE, np.array([rate, 0.1, 0.01])) for rate in (-0.2, 0.2))
    assert edge_m(early)[-1] > 0.03
    assert edge_m(late)[-1] > 0.025
    assert early.contact.end_s + 0.1 < late.contact.end_s


def test_above_the_table_the_wrist_moves_as_the_paper_says():
    motion = plan(HERE, np.array([-0.2, 0.1, 0.01]))
    wrist_m = motion.X_BT[:, :3, 3] + motion.X_BT[:, :3, :3] @ WRIST_IN_TOOL_M
    velocity = np.gradient(wrist_m, motion.t_s, axis=0)
    for t_s, forward_m_s, up_m_s in ((0.35, 0.7, -0.01), (0.60, 0.2, 0.01), (0.70, 0.0, 0.0)):
        np.testing.assert_allclose(velocity[round(t_s * 1000), [0, 2]], [forward_m_s, up_m_s], atol=2e-3)


def test_starts_so_far_behind_the_near_side_as_the_action_says_and_moves_along_with_it():
    action = np.array([0.0, 0.1, 0.012])
    here, there = plan(HERE, action), plan(CONTEXT.high, action)
    np.testing.assert_allclose(here.X_BT[0, :2, 3], [HERE[0] - 0.012, HERE[1]])
    shift_m = there.X_BT[:, :3, 3] - here.X_BT[:, :3, 3]
    np.testing.assert_allclose(shift_m, np.tile([*(CONTEXT.high - HERE), 0.0], (len(shift_m), 1)), atol=1e-12)
