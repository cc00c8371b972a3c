"""What an arm measures in a motion comes with it, through both drivers, as the arm reported it and never modelled."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell, move
from fr3_process import READY_RAD, Fr3Process, arm_at
from players import ReportedState, arm_of
from sdk_fake import WEIGHT_NM, WRENCH, FakeRobot, FakeSdk

from hw.dynamics import torque_Nm
from hw.errors import ArmFault
from hw.franka.playback import Playback, motion_of
from hw.mass import Mass
from hw.quantities import QUANTITIES
from hw.types import Execution

NAMES = {quantity.name for quantity in QUANTITIES}
PATH = move([0.1] * 7, 1.0, start_rad=np.array([0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.7]))


def felt(q_rad: list[float]) -> list[float]:
    """External torques that follow the arm, with noise that no two cycles share."""
    return [0.3 * q + 1e-3 * np.sin(1e4 * (q + joint)) for joint, q in enumerate(q_rad)]


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_every_quantity_that_an_arm_reports_is_logged_cycle_by_cycle(model: str) -> None:
    sdk = FakeSdk(k=model == "panda")
    with arm_of(sdk, model) as arm:
        sdk_alive, reported = sdk.feels, list[list[float]]()

        def feels(q_rad: list[float]) -> list[float]:
            reported.append(felt(q_rad) if sdk.modes.moving else sdk_alive(q_rad))
            return reported[-1]

        sdk.feels = feels
        played = arm.execute(PATH)
    assert set(played.measured) == NAMES == {"joint_torque_Nm", "external_torque_Nm", "external_wrench"}
    external_Nm = played.measured["external_torque_Nm"]
    np.testing.assert_array_equal(external_Nm, np.array(reported)[-len(played.t_s) :])
    assert np.ptp(external_Nm, axis=0).min() > 1e-3, "every cycle is its own"
    np.testing.assert_allclose(played.measured["joint_torque_Nm"], external_Nm + WEIGHT_NM)
    np.testing.assert_array_equal(played.measured["external_wrench"], np.tile(WRENCH, (len(played.t_s), 1)))


@pytest.mark.parametrize("gone", sorted(NAMES - {"external_torque_Nm"}))
def test_a_quantity_that_the_sdk_does_not_report_is_absent(gone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    field = next(quantity.state for quantity in QUANTITIES if quantity.name == gone)
    whole = FakeRobot._state

    def less(self: FakeRobot) -> object:
        state = whole(self)
        delattr(state, field)
        return state

    monkeypatch.setattr(FakeRobot, "_state", less)
    with arm_of(FakeSdk(k=False), "fr3") as arm:
        assert set(arm.execute(PATH).measured) == NAMES - {gone}


def test_a_quantity_with_a_value_that_is_none_is_left_out_and_the_motion_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = FakeRobot._state

    def broken(self: FakeRobot) -> object:
        state = whole(self)
        state.O_F_ext_hat_K[2] = float("nan")
        return state

    monkeypatch.setattr(FakeRobot, "_state", broken)
    with arm_of(FakeSdk(k=True), "panda") as arm:
        played = arm.execute(PATH)
    assert set(played.measured) == NAMES - {"external_wrench"}
    assert played.t_s[-1] >= PATH.duration_s


def test_a_motion_that_was_stopped_has_what_was_measured_until_then() -> None:
    sdk = FakeSdk(k=False)
    with arm_of(sdk, "fr3") as arm:

        def late(cycle: int) -> None:
            if cycle == 300:
                sdk.modes.reasons = ("joint_reflex",)

        sdk.when = late
        with pytest.raises(ArmFault):
            arm.execute(PATH)
        assert arm.last_execution is not None
        assert len(arm.last_execution.measured["joint_torque_Nm"]) == len(arm.last_execution.t_s) == 300


def test_a_motion_without_a_cycle_measured_nothing() -> None:
    motion = motion_of(PATH, cell("panda").motion)
    assert Playback(motion, lambda: "", lambda: 0.0).played().measured == {}
    assert not hasattr(ReportedState(), "tau_J")


@pytest.mark.parametrize(
    "measured", [{"joint_torque_Nm": np.zeros((2, 7))}, {"external_wrench": np.zeros((3, 7))}, {"other": np.zeros(3)}]
)
def test_a_quantity_has_a_row_for_each_cycle_and_its_own_size(measured: dict[str, np.ndarray]) -> None:
    with pytest.raises((ValueError, KeyError)):
        Execution(0.0, np.arange(3) / 1000, np.zeros((3, 7)), np.zeros((3, 7)), 1.0, measured)


@pytest.mark.long
def test_the_makers_fr3_protocol_carries_torques_of_the_motion(server: Fr3Process) -> None:
    """MuJoCo's torques: near those of the arm's weight, and not those of a model of ours."""
    with arm_at(server) as arm:
        played = arm.execute(move([0.1] * 7, 1.0, start_rad=READY_RAD))
    assert set(played.measured) == NAMES
    joint_Nm = played.measured["joint_torque_Nm"]
    still = np.zeros_like(played.q_measured_rad)
    modelled_Nm = torque_Nm("fr3", played.q_measured_rad, still, still, Mass(0.0, np.zeros(3), np.zeros((3, 3))))
    assert np.abs(joint_Nm[:, 3] - modelled_Nm[:, 3]).max() < 10.0
    assert np.abs(joint_Nm[:, 3]).min() > 10.0
    assert (joint_Nm != modelled_Nm).any(axis=0).all()
    assert np.ptp(played.measured["external_torque_Nm"], axis=0).min() > 1e-3
