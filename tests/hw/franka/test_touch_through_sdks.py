"""Guarded motions through the interface of either SDK, on an arm that follows at once and feels a springy plane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fr3_process import HandPedal
from guarded_paths import GUARD, Q_AWAY_RAD, Q_TOP_RAD, TIP, TOOL, TOP_M, approach, down
from players import InProcess, arm_of
from sdk_fake import FakeSdk

from hw.contact import began, estimate_errors_Nm
from hw.errors import ArmFault, MotionRefused, NoContact, StoppedByPedal
from hw.franka.settings import Payload
from hw.kinematics import forward, jacobian
from hw.types import Array, Guard

PATH = down(0.005, 0.008)
PLANE_M = TOP_M - 0.0025
STIFFNESS_N_M, ERROR_NM = 4000.0, 0.8


def tip_m(q_rad: Any) -> float:
    X_BF = forward(q_rad)
    return float((X_BF[:3, :3] @ TIP + X_BF[:3, 3])[2])


def plane(
    height_m: float, also: Callable[[float], None] = lambda force_N: None
) -> Callable[[list[float]], list[float]]:
    """What the joints feel of a plane, with noise and a constant error; `also` is told its force."""
    rng = np.random.default_rng(0)

    def feels(q: list[float]) -> list[float]:
        force_N = max(height_m - tip_m(q), 0.0) * STIFFNESS_N_M
        also(force_N)
        noise_Nm: Array = ERROR_NM + estimate_errors_Nm(np.array(q), rng)
        return (force_N * jacobian(q, TIP)[2] + noise_Nm).tolist() if force_N else noise_Nm.tolist()

    return feels


def fake(model: str, **more: Any) -> FakeSdk:
    return FakeSdk(k=model == "panda", q_rad=Q_AWAY_RAD.tolist(), **more)


@pytest.mark.long
@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize("lost", [(), (700, 900, 901, 1000)])
def test_a_touch_is_found_with_and_without_lost_cycles(model: str, lost: tuple[int, ...]) -> None:
    with arm_of(fake(model, feels=plane(PLANE_M), lost_cycles=lost), model, tool=TOOL) as arm:
        arm.execute(approach())
        contact = arm.execute_until_contact(PATH, GUARD)
        np.testing.assert_allclose(arm.state().q_rad, PATH.q_rad[0], atol=1e-9)
        assert arm.last_stop is not None
        assert arm.last_stop.why == "touch"
        assert arm.last_stop.braking_after_s <= 0.021
    touch = began(contact, GUARD)
    assert touch is not None
    assert tip_m(touch.q_rad) == pytest.approx(PLANE_M, abs=3e-4)
    np.testing.assert_allclose(np.diff(contact.felt_t_s), 1e-3, atol=1e-12)
    np.testing.assert_array_equal(contact.felt_commanded_rad, PATH.q_rad[: len(contact.felt_t_s)])
    np.testing.assert_allclose(contact.felt_measured_rad[1:], contact.felt_commanded_rad[:-1], atol=5e-5)


@pytest.mark.long
@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_the_air_is_no_contact(model: str) -> None:
    with arm_of(fake(model, feels=plane(-1.0)), model, tool=TOOL) as arm:
        arm.execute(approach())
        with pytest.raises(NoContact, match=f"{model}: the arm came to the end of its path"):
            arm.execute_until_contact(PATH, GUARD)
        np.testing.assert_allclose(arm.state().q_rad, PATH.q_rad[0], atol=1e-9)
        assert arm.state().fault is None


@pytest.mark.long
def test_a_pedal_let_go_there_and_on_the_way_back() -> None:
    """It is let go of by the force: of the search at 2 N of 4, of the way back once it has become less than 1 N."""
    for low_N, where in ((2.0, "search"), (None, "way back")):
        pedal = HandPedal()
        felt_N: list[float] = []

        def at(force_N: float, low_N: float | None = low_N, pedal: HandPedal = pedal, felt: Any = felt_N) -> None:
            felt.append(force_N)
            pedal.held = force_N < low_N if low_N else not (max(felt) > 4.0 and 0.0 < force_N < 1.0)

        with arm_of(fake("panda", feels=plane(PLANE_M, at)), tool=TOOL, pedal=pedal) as arm:
            arm.execute(approach())
            with pytest.raises(StoppedByPedal, match="pedal"):
                arm.execute_until_contact(PATH, GUARD)
            assert max(felt_N) < 4.0 if where == "search" else max(felt_N) > 4.0
            assert 1e-4 < TOP_M - tip_m(arm.state().q_rad) < 0.005
            assert "pedal" in (arm.state().fault or "")


@pytest.mark.long
def test_a_reflex_at_the_touch_is_a_fault_that_is_recovered_in_place() -> None:
    sdk = fake("panda")

    def hard(force_N: float) -> None:
        if force_N > 2.0:
            sdk.modes.reasons = ("cartesian_reflex",)

    sdk.feels = plane(PLANE_M, hard)
    with arm_of(sdk, "panda", tool=TOOL) as arm:
        arm.execute(approach())
        with pytest.raises(ArmFault, match="cartesian_reflex"):
            arm.execute_until_contact(PATH, GUARD)
        low_rad = arm.state().q_rad
        assert tip_m(low_rad) < PLANE_M
        sdk.feels = plane(-1.0)
        arm.recover()
        np.testing.assert_array_equal(arm.state().q_rad, low_rad)


@pytest.mark.long
def test_a_way_back_that_the_arm_does_not_hold_leaves_it_there_and_says_so() -> None:
    sdk = fake("panda", feels=plane(PLANE_M))
    with arm_of(sdk, "panda", tool=TOOL) as arm:
        arm.execute(approach())
        assert isinstance(arm._player, InProcess)
        robot, control = arm._player.driver._robot, arm._player.driver._robot.control_joint_position

        def pushed(*given: Any, **options: Any) -> None:
            control(*given, **options)
            robot._q = (np.array(robot._q) + 0.02).tolist()  # somebody pushed the arm away while it stood

        robot.control_joint_position = pushed
        with pytest.raises(ArmFault, match="go back"):
            arm.execute_until_contact(PATH, GUARD)
        assert "cannot go back from the contact" in (arm.state().fault or "")


def test_what_is_refused_has_not_moved() -> None:
    sdk = fake("panda", feels=plane(PLANE_M))
    sdk.q_rad = Q_TOP_RAD.tolist()
    with arm_of(sdk, "panda", tool=TOOL) as arm:
        with pytest.raises(MotionRefused, match="guard's force"):
            arm.execute_until_contact(PATH, Guard(41.0, TIP))
        with pytest.raises(MotionRefused, match="speed"):
            arm.execute_until_contact(down(0.005, 0.03), GUARD)
    assert not [name for name, _ in sdk.calls if name == "command"]


def test_what_the_hand_holds_reaches_the_arm_and_every_new_connection() -> None:
    sdk = fake("panda")
    with arm_of(sdk, "panda", tool=TOOL) as arm:
        arm.carry(TOOL, Payload(0.2, np.array([0.0, 0.0, 0.1])))
        arm._drop_player()
        arm.state()
    loads = [what[:2] for name, what in sdk.calls if name == "set_load"]
    assert loads == [(0.2, [0.0, 0.0, 0.1])] * 2
