"""From joint torques to a touch: force, detection, where it began, and what a guarded motion must keep to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cells import cell
from guarded_paths import GUARD, Q_TOP_RAD, TIP, TOOL, down, over

from hw.collision import LEVEL, KeepOut, Table
from hw.contact import Detector, began, contact_force, predicted_force_N, vertical_force_N
from hw.errors import ArmFault, MotionRefused, NoContact
from hw.fake import FakeArm, FakeClock
from hw.kinematics import forward, jacobian
from hw.types import ContactWindow, Guard, JointPath
from hw.workcell import DEPTH_M, SPEED_M_S, Workcell, check_guarded, require_guarded, withdrawal

CELL = cell(tool=TOOL)


def stopping_at(stops_at_N: float) -> Workcell:
    return replace(CELL, stops_at_N=stops_at_N)


def noise(path: JointPath, std_Nm: float, seed: int = 0) -> np.ndarray:
    return std_Nm * np.random.default_rng(seed).standard_normal(path.q_rad.shape)


def arm(plane: Table | None, torque_Nm: np.ndarray | None = None) -> FakeArm:
    return FakeArm(Q_TOP_RAD, FakeClock(), CELL, plane=plane, torque_Nm=torque_Nm)


def test_a_force_on_the_point_is_found_from_the_torques() -> None:
    q, force_N = Q_TOP_RAD[None], np.array([3.0, -2.0, 7.0])
    torque_Nm = force_N @ jacobian(q, TIP)[0, :3]
    np.testing.assert_allclose(contact_force(q, torque_Nm[None], TIP)[0], force_N, atol=1e-9)


def test_one_posture_in_plain_floats_gives_the_same_force() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        q, torque_Nm, p_F_m = rng.uniform(-2.0, 2.0, 7), rng.standard_normal(7), 0.1 * rng.standard_normal(3)
        expected = contact_force(q[None], torque_Nm[None], p_F_m)[0, 2]
        given = vertical_force_N(q.tolist(), torque_Nm.tolist(), p_F_m.tolist())
        assert given == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("height_m", [-0.008, 0.0, 0.006])
def test_where_it_touched_is_found_in_the_noise(height_m: float) -> None:
    path = down()
    with arm(Table(height_m), noise(path, 0.15) + 0.8) as feeling:  # a constant error is tared away
        contact = feeling.execute_until_contact(path, GUARD)
    touch = began(contact, GUARD)
    assert touch is not None
    X = forward(touch.q_rad)
    assert (X[:3, :3] @ TIP + X[:3, 3])[2] == pytest.approx(height_m, abs=2e-4)
    assert touch.stiffness_N_m == pytest.approx(4000.0, rel=0.1)
    assert touch.sigma_m < 1e-4
    assert contact.force_N < predicted_force_N(GUARD, 0.004)


def test_a_touch_is_found_where_the_estimate_drifted_before_it() -> None:
    """The ripple of the gears differs between the tare and the table; here by half of the guard's force."""
    path = down()
    drift_N = 2.4 * np.clip(path.t_s - 0.5, 0.0, 1.0)
    torque_Nm = drift_N[:, None] * jacobian(path.q_rad, TIP)[:, 2]
    with arm(Table(0.0), noise(path, 0.15) + torque_Nm) as feeling:
        contact = feeling.execute_until_contact(path, GUARD)
    touch = began(contact, GUARD)
    assert touch is not None
    X = forward(touch.q_rad)
    assert (X[:3, :3] @ TIP + X[:3, 3])[2] == pytest.approx(0.0, abs=2e-4)


def test_a_spike_is_no_touch_and_a_pull_is() -> None:
    path = down()
    knocked = noise(path, 0.02)
    knocked[1200:1204] += 8.0  # 4 ms
    with arm(None, knocked) as feeling, pytest.raises(NoContact, match="touched nothing"):
        feeling.execute_until_contact(path, GUARD)
    pulled = np.zeros((len(path.t_s), 7))
    pulled[1200:] = np.array([0.0, 0.0, -6.0]) @ jacobian(Q_TOP_RAD, TIP)[:3]
    with arm(None, pulled) as feeling:
        contact = feeling.execute_until_contact(path, GUARD)
    assert 1.2 < contact.t_s < 1.26
    assert began(contact, GUARD) is None or began(contact, GUARD).stiffness_N_m > 1e5  # it came at once


def test_the_detector_may_be_fed_in_pieces() -> None:
    path = down()
    torque_Nm = noise(path, 0.1)
    torque_Nm[2000:] += np.array([0.0, 0.0, 9.0]) @ jacobian(Q_TOP_RAD, TIP)[:3]
    whole = Detector(GUARD).feed(path.t_s, path.q_rad, torque_Nm)
    pieces, at = Detector(GUARD), None
    for begin in range(0, len(path.t_s), 37):
        part = slice(begin, begin + 37)
        found = pieces.feed(path.t_s[part], path.q_rad[part], torque_Nm[part])
        if found is not None:
            at = begin + found
            break
    assert whole == at
    assert whole is not None


def test_the_largest_force_counts_what_is_felt_while_it_brakes() -> None:
    path = down()
    rising_N = np.maximum(path.t_s - 2.0, 0.0) * 20.0
    torque_Nm = rising_N[:, None] * jacobian(path.q_rad, TIP)[:, 2]
    detector = Detector(GUARD)
    at = detector.feed(path.t_s, path.q_rad, torque_Nm)
    assert at is not None
    assert rising_N[at] == pytest.approx(GUARD.force_N, abs=0.3)  # the median is 12 ms late
    assert detector.largest_N == pytest.approx(GUARD.force_N, abs=0.03)
    after = slice(at + 1, at + 101)
    assert detector.feed(path.t_s[after], path.q_rad[after], torque_Nm[after]) is None
    assert detector.largest_N == pytest.approx(GUARD.force_N + 2.0, abs=0.3)


def test_a_guarded_motion_keeps_to_its_own_limits() -> None:
    assert check_guarded(down(), GUARD, CELL, Q_TOP_RAD).ok
    assert not CELL.check(down(), Q_TOP_RAD).ok  # any other motion may not go there
    with pytest.raises(MotionRefused, match="speed"):
        require_guarded(down(speed_m_s=1.5 * SPEED_M_S), GUARD, CELL)
    with pytest.raises(MotionRefused, match="search"):
        require_guarded(down(way_m=0.02 + 1.2 * DEPTH_M), GUARD, CELL)
    with pytest.raises(MotionRefused, match="window"):
        require_guarded(JointPath(down().t_s, down().q_rad), GUARD, CELL)
    with pytest.raises(MotionRefused, match="distance"):
        require_guarded(down(), GUARD, CELL, over(0.05))


def test_what_is_not_to_touch_must_stay_higher_than_the_tip() -> None:
    short = replace(TOOL, points_F_m=TIP[None] - np.array([0.0, 0.0, 0.04]))
    with pytest.raises(MotionRefused, match="lead"):
        require_guarded(down(), GUARD, CELL.holding(short))


def test_forces_stay_below_the_arms_own_threshold() -> None:
    path = down()
    assert path.contact is not None
    require_guarded(path, GUARD, stopping_at(1.3 * path.contact.force_N))
    with pytest.raises(MotionRefused, match="contact force"):
        require_guarded(path, GUARD, stopping_at(1.1 * path.contact.force_N))
    with pytest.raises(MotionRefused, match="guard's force"):
        require_guarded(path, replace(GUARD, force_N=6.0), stopping_at(11.0))


def test_no_threshold_lets_a_guarded_motion_press_harder_than_any_other() -> None:
    path = down()
    assert path.contact is not None
    for force_N, allowed in ((59.0, True), (61.0, False)):
        hard = replace(path, contact=replace(path.contact, force_N=force_N))
        report = check_guarded(hard, GUARD, stopping_at(100.0))
        assert report.ok == allowed, str(report.worst)


def test_a_planned_contact_is_held_against_the_arms_own_threshold() -> None:
    q = np.stack([Q_TOP_RAD, Q_TOP_RAD])
    path = JointPath(np.array([0.0, 1e-3]), q, ContactWindow(0.0, 1e-3, 0.003, 30.0))
    assert CELL.check(path).ok
    assert stopping_at(40.0).check(path).ok
    worst = stopping_at(20.0).check(path).worst
    assert (worst.quantity, worst.limit) == ("predicted contact force", 16.0)


def test_the_way_back_is_the_way_there() -> None:
    path = down()
    back = withdrawal(path)
    np.testing.assert_array_equal(back.q_rad[0], path.q_rad[-1])
    np.testing.assert_array_equal(back.q_rad[-1], path.q_rad[0])
    assert check_guarded(back, GUARD, CELL).ok


def test_a_guard_and_boxes_are_checked() -> None:
    with pytest.raises(ValueError, match="above 0"):
        Guard(0.0, TIP)
    box = KeepOut("thing", np.array([0.4, -0.1, 0.0]), np.array([0.6, 0.1, 0.2]))
    with pytest.raises(MotionRefused, match="thing"):
        require_guarded(down(), GUARD, replace(CELL, keep_out=(box,)))


def test_a_stopped_arm_feels_nothing() -> None:
    with FakeArm(Q_TOP_RAD, FakeClock(), CELL, faults={1: ArmFault("reflex")}, plane=LEVEL) as feeling:
        still = JointPath(np.array([0.0, 1e-3]), np.stack([Q_TOP_RAD, Q_TOP_RAD]))
        with pytest.raises(ArmFault):
            feeling.execute(still)
        with pytest.raises(ArmFault, match="recover"):
            feeling.execute_until_contact(down(), GUARD)
