"""A guarded motion of the FR3, over its real network protocol, onto a springy plane that its joints feel."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from fr3_process import Fr3Process, HandPedal, arm_at, fr3
from guarded_paths import GUARD, Q_AWAY_RAD, TIP, TOOL, TOP_M, approach, down

from hw.contact import began, predicted_force_N
from hw.errors import ArmFault, DeviceUnavailable, StoppedByPedal
from hw.franka.arm import FrankaArm
from hw.joint_limits import LIMITS, derivatives
from hw.kinematics import forward
from hw.types import Array

WAY_M, SPEED_M_S = 0.005, 0.008
PATH = down(WAY_M, SPEED_M_S)
PLANE_M = TOP_M - 0.0025
"""Met about half way, at full speed."""
AIR_M = -1.0
BEND_RAD = 3e-3
"""How far the simulated arm hangs below its path."""


def tip_m(q_rad: Array) -> float:
    X_BF = forward(q_rad)
    return float((X_BF[:3, :3] @ TIP + X_BF[:3, 3])[2])


@pytest.fixture(scope="module")
def shared() -> Iterator[Fr3Process]:
    with fr3(Q_AWAY_RAD, pace="hurried") as running:
        yield running


@pytest.fixture
def server(shared: Fr3Process) -> Fr3Process:
    shared.place(Q_AWAY_RAD)
    shared.plane(PLANE_M, TIP)
    return shared


@contextmanager
def over_it(server: Fr3Process, pedal: HandPedal | None = None) -> Iterator[FrankaArm]:
    """The arm over the plane, come from elsewhere."""
    with arm_at(server, tool=TOOL, pedal=pedal) as arm:
        arm.execute(approach())
        yield arm


def stopped_on_the_way(arm: FrankaArm, reason: str) -> None:
    """At rest, low, with a fault that lasts until it is recovered; recovering moves nothing."""
    state = arm.state()
    assert reason in (state.fault or "")
    assert np.abs(state.dq_rad_s).max() < 0.02
    assert tip_m(state.q_rad) < TOP_M - 0.0008
    with pytest.raises(ArmFault, match="recover"):
        arm.execute_until_contact(PATH, GUARD)
    arm.recover()
    np.testing.assert_allclose(arm.state().q_rad, state.q_rad, atol=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("height_m", [PLANE_M, PLANE_M + 0.0006])
def test_a_touch_is_found_and_the_arm_is_back_where_it_began(server: Fr3Process, height_m: float) -> None:
    server.plane(height_m, TIP)
    with over_it(server) as arm:
        before = arm.state()
        contact = arm.execute_until_contact(PATH, GUARD)
        after = arm.state()
        np.testing.assert_allclose(server.commanded()[-1], PATH.q_rad[0], atol=BEND_RAD)
        stop = arm.last_stop
    touch = began(contact, GUARD)
    assert touch is not None
    assert tip_m(touch.q_rad) == pytest.approx(height_m, abs=3e-4)
    assert GUARD.force_N <= contact.force_N < predicted_force_N(GUARD, SPEED_M_S)
    assert after.fault is None
    np.testing.assert_allclose(after.q_rad, before.q_rad, atol=1e-3)
    np.testing.assert_allclose(np.diff(contact.felt_t_s), 1e-3, atol=1e-9)
    assert contact.felt_torque_Nm.shape == contact.felt_measured_rad.shape == contact.felt_commanded_rad.shape
    assert contact.t_s == contact.felt_t_s[-1]
    assert stop is not None
    assert stop.why == "touch"
    assert stop.braking_after_s <= 0.021


@pytest.mark.long
def test_all_that_is_commanded_keeps_the_limits_there_and_back(server: Fr3Process) -> None:
    limits, logs = LIMITS["fr3"], []
    with over_it(server) as arm:
        arm.execute_until_contact(PATH, GUARD)
        logs.append(server.commanded())
        assert arm.last_execution is not None
        logs.append(arm.last_execution.q_commanded_rad)
    for q in logs:
        dq, ddq, dddq = derivatives(q)
        assert limits.ratios(np.concatenate([q, np.repeat(q[-1:], 3, axis=0)]), dq, ddq).max() <= 1.0
        assert (np.abs(dddq) / limits.dddq_max_rad_s3).max() <= 1.0
    np.testing.assert_allclose(logs[0][0], logs[1][-1], atol=1e-6)  # the way back begins where the way there ended


@pytest.mark.long
@pytest.mark.parametrize("searching", [True, False])
def test_the_pedal_let_go_during_the_search_and_on_the_way_back(server: Fr3Process, searching: bool) -> None:
    pedal = HandPedal()
    if searching:
        server.plane(AIR_M, TIP)
    with over_it(server, pedal=pedal) as arm:
        server.at(PATH.duration_s / 2.0 if searching else 0.2, pedal.release, after=0 if searching else 1)
        with pytest.raises(StoppedByPedal, match=r"pedal was released \d\.\d+ s into the path; braking began"):
            arm.execute_until_contact(PATH, GUARD)
        assert arm.last_stop is not None
        assert arm.last_stop.why == "pedal"
        pedal.held = True
        stopped_on_the_way(arm, "pedal")


@pytest.mark.long
def test_the_pedal_let_go_at_the_touch_leaves_the_arm_there(server: Fr3Process) -> None:
    """It brakes for the touch already; the way back does not begin."""
    pedal = HandPedal()
    with over_it(server, pedal=pedal) as arm:

        def release() -> None:
            pedal.held = False

        arm.execute_until_contact(PATH, GUARD)
        assert arm.last_stop is not None
        server.at(arm.last_stop.at_s + 0.015, release)
        with pytest.raises(StoppedByPedal, match="pedal"):
            arm.execute_until_contact(PATH, GUARD)
        pedal.held = True
        stopped_on_the_way(arm, "pedal")


@pytest.mark.long
def test_a_stop_that_is_asked_for_during_the_search(server: Fr3Process) -> None:
    server.plane(AIR_M, TIP)
    with over_it(server) as arm:
        server.at(PATH.duration_s / 2.0, arm.stop)
        with pytest.raises(ArmFault, match="requested"):
            arm.execute_until_contact(PATH, GUARD)
        stopped_on_the_way(arm, "stop was requested")


@pytest.mark.long
def test_a_reflex_while_touching_is_a_fault(server: Fr3Process) -> None:
    server.tell("threshold 2.0")
    with over_it(server) as arm:
        with pytest.raises(ArmFault, match="cartesian_reflex"):
            arm.execute_until_contact(PATH, GUARD)
        server.tell("threshold inf")
        stopped_on_the_way(arm, "cartesian_reflex")


@pytest.mark.long
def test_a_connection_lost_half_way_is_a_fault_then_unavailable() -> None:
    with fr3(Q_AWAY_RAD, pace="hurried") as server, over_it(server) as arm:
        server.at(1.0, lambda: server.signal(signal.SIGKILL))
        with pytest.raises(ArmFault, match="answer"):
            arm.execute_until_contact(PATH, GUARD)
        with pytest.raises(DeviceUnavailable, match="refuses"):
            arm.state()
