"""What the arm reports of load, hand and joints, against what it was sent, what the rig counts on, and its range."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cells import READY, cell, move
from fr3_process import RELAXED, Fr3Process
from players import ReportedState, arm_of, driver_of
from sdk_fake import HAND, FakeSdk

from hw.collision import HAND_MASS
from hw.errors import ArmFault, DeviceUnavailable
from hw.franka.arm import franka
from hw.franka.driver import LOST, Failure
from hw.franka.playback import NONSENSE, Playback, motion_of
from hw.franka.settings import FrankaSettings, Payload
from hw.joint_limits import BEYOND_RAD, LIMITS
from hw.mass import NOTHING
from hw.types import Array, JointPath

MODELS = ["panda", "fr3"]
PAYLOAD = Payload(0.45, np.array([0.01, -0.02, 0.12]), np.diag([2e-3, 3e-3, 1e-3]))
SETTINGS = FrankaSettings("172.16.0.2", PAYLOAD)


def sdk_of(model: str, **more: Any) -> FakeSdk:
    return FakeSdk(k=model == "panda", **more)


def little(q_rad: Array) -> JointPath:
    return move([0.05, -0.03, 0.03, 0.02, 0.04, 0.03, -0.05], 0.6, start_rad=q_rad)


def moved(sdk: FakeSdk) -> bool:
    return any(name == "command" for name, _ in sdk.calls)


@pytest.mark.parametrize("model", MODELS)
def test_a_load_that_the_arm_never_took_moves_nothing_and_says_both(model: str) -> None:
    sdk = sdk_of(model, takes_loads=False)
    with arm_of(sdk, model, SETTINGS) as arm:
        path = little(arm.state().q_rad)
        with pytest.raises(ArmFault, match=r"mass 0 kg, expected 0\.45 kg \(at most 0\.001 kg apart\).*nothing has"):
            arm.execute(path)
        assert not moved(sdk)
        sdk.takes_loads = True
        arm.recover()
        arm.execute(path)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (replace(PAYLOAD, mass_kg=0.452), r"mass 0\.45 kg, expected 0\.452 kg"),
        (replace(PAYLOAD, com_F_m=np.array([0.01, -0.02, 0.121])), r"centre of mass .*0\.12 m, expected .*0\.121 m"),
        (replace(PAYLOAD, inertia_F_kg_m2=np.diag([2e-3, 3.1e-3, 1e-3])), r"inertia .*0\.003.*expected .*0\.0031"),
    ],
)
def test_every_part_of_a_load_is_read_back(model: str, changed: Payload, words: str) -> None:
    sdk = sdk_of(model)
    driver = driver_of(sdk, model, SETTINGS)
    driver.prepare(driver.reading().at_s)
    sdk.takes_loads = False
    with pytest.raises(Failure, match=words):
        driver.carry(changed)
    with pytest.raises(Failure, match=rf"{words}.*nothing has moved"):
        driver.prepare(driver.reading().at_s)


@pytest.mark.parametrize("model", MODELS)
def test_a_load_may_be_taken_some_states_later(model: str) -> None:
    sdk = sdk_of(model, takes_loads=False)
    driver = driver_of(sdk, model, SETTINGS)
    checked_s, read_once = driver.reading().at_s, sdk.robot.read_once
    reads = 0

    def late() -> Any:
        nonlocal reads
        reads += 1
        if reads == 50:
            sdk.robot._load = next(what for name, what in sdk.calls if name == "set_load")
        return read_once()

    sdk.robot.read_once = late
    driver.prepare(checked_s)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("hand", "words"),
    [
        ((0.0, [0.0] * 3, [0.0] * 9), r"mass 0 kg, expected 0\.73 kg \(at most 0\.05 kg apart\); set the hand there"),
        ((0.8, *HAND[1:]), r"mass 0\.8 kg, expected 0\.73 kg"),
        ((HAND[0], [-0.01, 0.0, 0.045], HAND[2]), r"centre of mass .*0\.045 m, expected"),
        ((HAND[0], HAND[1], [0.01, *HAND[2][1:]]), r"inertia 0\.01, .*expected 0\.001,"),
    ],
)
def test_another_end_effector_in_desk_than_the_rigs_moves_nothing(model: str, hand: Any, words: str) -> None:
    sdk = sdk_of(model, hand=hand)
    with arm_of(sdk, model, SETTINGS) as arm:
        state = arm.state()
        assert re.search(words, state.fault or ""), "doctor and every command say it before a motion"
        assert not state.by_hand
        path = little(state.q_rad)
        with pytest.raises(ArmFault, match=rf"set in Desk is not the hand: {words}"):
            arm.execute(path)
        assert not moved(sdk)
        with pytest.raises(ArmFault, match=words):
            arm.recover()
        sdk.hand = HAND
        arm.recover()
        arm.execute(path)


@pytest.mark.parametrize("model", MODELS)
def test_an_end_effector_that_is_changed_after_the_check_moves_nothing(model: str) -> None:
    sdk = sdk_of(model)
    driver = driver_of(sdk, model, SETTINGS)
    checked_s = driver.reading().at_s
    sdk.hand = (1.2, *HAND[1:])
    with pytest.raises(Failure, match=r"not the hand: mass 1\.2 kg.*nothing has moved"):
        driver.prepare(checked_s)


def test_the_hand_that_is_expected_is_the_one_that_every_check_counts_on() -> None:
    assert SETTINGS.end_effector is HAND_MASS
    bare = replace(SETTINGS, end_effector=NOTHING)
    driver = driver_of(sdk_of("fr3", hand=(0.0, [0.0] * 3, [0.0] * 9)), "fr3", bare)
    driver.prepare(driver.reading().at_s)


@pytest.mark.long
def test_load_and_hand_are_read_back_over_the_network(server: Fr3Process) -> None:
    settings = FrankaSettings(server.host, PAYLOAD)
    with franka(cell("fr3"), settings, RELAXED) as arm:
        path = little(arm.state().q_rad)
        server.tell("hand 0.2")
        with pytest.raises(ArmFault, match=r"not the hand: mass 0\.2 kg, expected 0\.73 kg"):
            arm.execute(path)
        server.tell("hand 0.73")
        arm.recover()
        arm.execute(path)
        server.tell("deaf")
        with pytest.raises(ArmFault, match=r"mass 0\.45 kg, expected 0\.2 kg"):
            arm.carry(cell("fr3").tool, replace(PAYLOAD, mass_kg=0.2))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("joint", range(7))
def test_joints_that_no_arm_can_have_are_no_state(model: str, joint: int) -> None:
    limits = LIMITS[model]
    for bound_rad, outwards in ((limits.q_max_rad[joint], 1.0), (limits.q_min_rad[joint], -1.0)):
        for beyond_rad, nonsense in ((0.9 * BEYOND_RAD, False), (1.1 * BEYOND_RAD, True), (1e6, True)):
            q_rad = READY.copy()
            q_rad[joint] = bound_rad + outwards * beyond_rad
            driver = driver_of(sdk_of(model, q_rad=q_rad.tolist()), model)
            if nonsense:
                with pytest.raises(
                    Failure, match=rf"reports nonsense \(joint {joint + 1} at .* its range is"
                ) as raised:
                    driver.reading()
                assert raised.value.kind == LOST
            else:
                assert driver.reading().q_rad == tuple(q_rad)


@pytest.mark.parametrize("model", MODELS)
def test_all_joints_zero_is_no_state_of_either_arm(model: str) -> None:
    with arm_of(sdk_of(model, q_rad=[0.0] * 7), model) as arm, pytest.raises(DeviceUnavailable, match="nonsense"):
        arm.state()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("q_rad", [[0.0] * 7, [float("nan")] * 7, [*READY[:6], 9.0]])
def test_a_motion_brakes_where_the_arm_reports_such_joints_and_its_log_keeps_none_of_them(
    model: str, q_rad: list[float]
) -> None:
    path = little(READY)
    playback = Playback(motion_of(path, cell(model).motion), lambda: "", lambda: 0.0, start_s=600.0)
    q, finished, cycle = READY.tolist(), False, 0
    while not finished:
        q, finished = playback.step(ReportedState(q_rad if cycle > 200 else q, q_d=q), 0.001 if cycle else 0.0)
        cycle += 1
    played = playback.played()
    assert (played.stop_wanted, played.wanted_at) == (NONSENSE, 201)
    np.testing.assert_allclose(played.q_measured_rad, played.q_commanded_rad, atol=0.01)
