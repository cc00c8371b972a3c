import time

import numpy as np
import pytest
from cells import READY, cell, find, joint, move, stick

from hw.collision import KeepOut
from hw.errors import MotionRefused
from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.limits import Worst
from hw.types import ContactWindow, JointPath

PANDA, FR3 = cell(), cell("fr3")


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_a_gentle_move_is_accepted(model: str) -> None:
    report = cell(model).require(move(np.full(7, 0.3)), READY)
    assert report.ok
    assert 0.4 < report.joint_ratio < 0.7


def test_velocity_names_joint_time_value_and_limit() -> None:
    """A seventh-order step of 1 rad in 1 s peaks in the middle at 2.1875 rad/s; joint 3 may do 2.175 - 3 ms * 10."""
    worst = find(move(joint(3, 1.0), 1.0), "velocity", PANDA)
    assert (worst.where, worst.t_s) == ("joint 3", pytest.approx(0.5, abs=0.002))
    assert worst.value == pytest.approx(2.1875, rel=1e-4)
    assert worst.limit == pytest.approx(2.145)
    with pytest.raises(MotionRefused, match=r"velocity of joint 3 at t = 0\.50. s is 2\.187 rad/s, limit 2\.145 rad/s"):
        PANDA.require(move(joint(3, 1.0), 1.0))


def test_acceleration_and_jerk_are_those_of_the_samples() -> None:
    acceleration = find(move(joint(2, -0.3), 0.5), "acceleration", PANDA)
    assert abs(acceleration.value) == pytest.approx(7.5132 * 0.3 / 0.25, rel=1e-3)
    assert acceleration.where == "joint 2"
    assert acceleration.ratio > 1.0
    jerk = find(move(joint(2, -0.3), 0.1), "jerk", PANDA)
    assert abs(jerk.value) == pytest.approx(52.5 * 0.3 / 1e-3, rel=1e-2)


def test_position_limits_differ_between_the_arms() -> None:
    up = move(joint(6, 2.3), 4.0)  # 3.87 rad: above the Panda's 3.7525, under the FR3's 4.6216
    assert find(up, "position", PANDA).ratio > 1.0
    assert find(up, "position", FR3).ratio < 1.0


def test_fr3_velocity_shrinks_towards_its_position_limits() -> None:
    limits = LIMITS["fr3"]
    low, high = limits.velocity_bounds((limits.q_min_rad + limits.q_max_rad) / 2)
    assert np.allclose(high[4:] + 0.03, [5.26, 4.18, 5.26])
    q = limits.q_max_rad - 0.3
    low, high = limits.velocity_bounds(q)
    expected = -0.6599 + np.sqrt(2 * 6.0 * 0.3)
    assert high[0] == pytest.approx(expected - 0.03)
    assert low[0] == pytest.approx(-2.62 + 0.03)
    assert np.all(limits.velocity_bounds(limits.q_max_rad)[1] == 0.0)
    mirrored = limits.velocity_bounds(limits.q_min_rad + 0.3)[0]
    assert mirrored[0] == pytest.approx(-high[0])


def test_a_path_that_starts_or_ends_in_motion_is_refused() -> None:
    t_s = np.arange(1001) / 1000
    moving = JointPath(t_s, READY + np.outer(t_s, joint(1, 0.1)))
    assert find(moving, "end velocity", PANDA).ratio == pytest.approx(10.0)
    accelerating = JointPath(t_s[:-500], READY + np.outer(t_s[:-500] ** 2, joint(1, 5.0)))
    assert find(accelerating, "jerk", PANDA).ratio > 1.0  # 10 rad/s² from one millisecond to the next
    still = JointPath(t_s, np.tile(READY, (len(t_s), 1)))
    assert PANDA.check(still, READY).ok


def test_start_must_be_where_the_arm_is() -> None:
    path = move(joint(1, 0.2))
    assert PANDA.require(path, READY + joint(4, 0.005)).ok
    with pytest.raises(MotionRefused, match=r"distance from the arm of joint 4 .* is 0\.02 rad, limit 0\.01 rad"):
        PANDA.require(path, READY + joint(4, 0.02))


def test_self_collision_names_the_pair() -> None:
    worst = find(move(joint(6, -1.58) + joint(4, -0.7) + joint(7, -np.pi / 4), 6.0), "self-collision", PANDA)
    assert worst.ratio > 1.0
    assert worst.where == "link 2 and guide button"


def test_keep_out_boxes_are_kept_out_of() -> None:
    box = KeepOut("camera", np.array([0.2, 0.3, 0.0]), np.array([0.4, 0.5, 1.0]))
    assert cell(keep_out=(box,)).check(move(joint(1, 0.3))).ok
    with pytest.raises(MotionRefused, match="keep-out"):
        cell(keep_out=(box,)).require(move(joint(1, 1.0)), READY)


def test_the_tool_may_touch_the_table_only_in_the_declared_window() -> None:
    bow = joint(2, 0.5075) + joint(4, -0.025)
    there = move(bow, 3.0).q_rad
    q = np.concatenate([there, there[-2::-1]])
    t_s = np.arange(len(q)) / 1000

    def deep(contact: ContactWindow | None) -> Worst:
        return find(JointPath(t_s, q, contact), "depth in the table", cell(tool=stick([0, 0, REACH])))

    touching = deep(None)
    assert touching.value == pytest.approx(0.003, abs=1e-4)
    assert touching.ratio == pytest.approx(touching.value / 0.0005)
    assert touching.t_s == pytest.approx(3.0, abs=0.002)
    assert deep(ContactWindow(2.0, 4.0, 0.003, 15.0)).ratio < 1.0
    assert deep(ContactWindow(2.0, 4.0, 0.001, 15.0)).ratio > 1.0
    assert deep(ContactWindow(0.0, 2.5, 0.003, 15.0)).ratio > 1.0


def bowed_reach() -> float:
    """Length of the stick whose tip is 3 mm under the table at the bottom of the bow."""
    X = forward(READY + joint(2, 0.5075) + joint(4, -0.025))
    return float((X[2, 3] + 0.003) / -X[2, 2])


REACH = bowed_reach()


def test_a_window_may_not_declare_more_than_the_arm_bears() -> None:
    deep = move(joint(1, 0.1), contact=ContactWindow(0.5, 1.0, 0.011, 15.0))
    with pytest.raises(MotionRefused, match=r"declared contact depth .* is 0\.011 m, limit 0\.006 m"):
        PANDA.require(deep)
    hard = move(joint(1, 0.1), contact=ContactWindow(0.5, 1.0, 0.002, 90.0))
    with pytest.raises(MotionRefused, match=r"predicted contact force .* is 90 N, limit 60 N"):
        PANDA.require(hard)


def test_a_refusal_lists_everything_worst_first() -> None:
    with pytest.raises(MotionRefused) as refused:
        PANDA.require(move(joint(1, 1.0) + joint(2, 0.6), 0.4), READY + joint(7, 0.02))
    order = ("acceleration of joint 2", "velocity of joint 1", "distance from the arm of joint 7")
    places = [str(refused.value).index(text) for text in order]
    assert places == sorted(places)


def test_a_path_of_3_s_is_checked_fast() -> None:
    path = move(np.full(7, 0.3), 3.0)
    PANDA.check(path)
    times = []
    for _ in range(5):
        start = time.process_time()
        PANDA.check(path, READY)
        times.append(time.process_time() - start)
    assert min(times) < 0.1
