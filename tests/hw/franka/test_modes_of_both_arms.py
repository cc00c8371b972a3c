"""What both arms of the tests take in which mode, and that the drivers lead from every one of them to a motion.

The Panda is its stand-in SDK, the FR3 the maker's SDK over the network protocol. Both answer from one table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from cells import cell, move
from fr3_process import READY_RAD, RELAXED, Fr3Process
from franka_modes import ANSWERS, COMMANDS, FLAGS, MODES, NOT_FINITE, SETTERS
from players import InProcess, arm_of, driver_of
from sdk_fake import FakeRobot, FakeSdk, JointPositions

from hw.errors import ArmFault, DeviceUnavailable
from hw.franka.arm import franka
from hw.franka.driver import UNMOVED, Failure, Reading
from hw.franka.playback import Playback, PlayOutcome, motion_of
from hw.franka.settings import FrankaSettings
from hw.types import JointPath

BY_HAND_MODES = ("UserStopped", "Guiding")
LASTING = tuple(mode for mode in MODES if mode not in ("Move", "AutomaticErrorRecovery"))


def asked(robot: Any, name: str) -> Callable[[], object]:
    """A command of libfranka's with harmless arguments."""
    calls: dict[str, Callable[[], object]] = {
        "set_collision_behavior": lambda: robot.set_collision_behavior([10.0] * 7, [20.0] * 7, [10.0] * 6, [20.0] * 6),
        "set_joint_impedance": lambda: robot.set_joint_impedance([2000.0] * 7),
        "set_load": lambda: robot.set_load(0.0, [0.0] * 3, [0.0] * 9),
        "move": lambda: robot.start_joint_position_control(_mode(robot)),
        "recover": robot.automatic_error_recovery,
        "read": robot.read_once,
    }
    return calls[name]


def _mode(robot: object) -> object:
    if isinstance(robot, FakeRobot):
        return "JointImpedance"
    import pylibfranka  # noqa: PLC0415

    return pylibfranka.ControllerMode.JointImpedance


def said(call: Callable[[], object]) -> str | None:
    """What a command raises, None where it is taken."""
    try:
        call()
    except RuntimeError as error:
        return str(error)
    return None


def test_the_stand_in_and_the_protocol_answer_every_command_in_every_mode_from_one_table(server: Fr3Process) -> None:
    import pylibfranka  # noqa: PLC0415

    real = pylibfranka.Robot(server.host, pylibfranka.RealtimeConfig.kIgnore)
    for mode in sorted(LASTING, key="Idle".__eq__):  # a motion that is taken ends the list
        for command in sorted(COMMANDS, key="move".__eq__):
            sdk = FakeSdk(k=False)
            sdk.modes.be(mode)
            server.tell(f"mode {mode}")
            _until_shown(real, mode)
            by_stand_in, by_protocol = said(asked(FakeRobot(sdk), command)), said(asked(real, command))
            assert by_stand_in == by_protocol, f"{command} in {mode}"
            assert (by_stand_in is None) == (ANSWERS[command, mode] is None), f"{command} in {mode}"


def _until_shown(robot: object, mode: str) -> None:
    for _ in range(2000):
        if robot.read_once().robot_mode.name == mode:  # type: ignore[attr-defined]
            return
    raise AssertionError(f"the arm never came to {mode}")


def test_setters_are_commands_of_idle_alone() -> None:
    for command in SETTERS:
        assert [mode for mode in MODES if ANSWERS[command, mode] is None] == ["Idle"]


def test_every_flag_of_the_wire_has_its_name_in_the_sdk(server: Fr3Process) -> None:
    import pylibfranka  # noqa: PLC0415

    real = pylibfranka.Robot(server.host, pylibfranka.RealtimeConfig.kIgnore)
    names = [name for name in dir(pylibfranka.Errors) if not name.startswith("_")]
    assert sorted(names) == sorted(FLAGS)
    for index, name in enumerate(FLAGS):
        server.tell(f"flags {index}")
        for _ in range(2000):
            errors = real.read_once().current_errors
            shown = [one for one in names if getattr(errors, one) is True]
            if shown == [name]:
                break
        assert shown == [name]


CHANGE_RAD = np.array([0.05, -0.03, 0.03, 0.02, 0.04, 0.03, -0.05])


def rad(q_rad: np.ndarray) -> JointPath:
    return move(CHANGE_RAD, 0.6, start_rad=q_rad)


@pytest.mark.parametrize("mode", [mode for mode in LASTING if mode != "Idle"])
def test_a_panda_found_in_any_mode_connects_explains_recovers_and_moves(mode: str) -> None:
    sdk = FakeSdk(k=True)
    sdk.modes.be(mode)
    with arm_of(sdk) as arm:
        assert not any(name in SETTERS for name, _ in sdk.calls), "it takes them only when Idle"
        state = arm.state()
        assert state.fault
        assert state.by_hand == (mode in BY_HAND_MODES)
        with pytest.raises(ArmFault, match="recover"):
            arm.execute(rad(state.q_rad))
        if mode != "Reflex":
            with pytest.raises(ArmFault, match="recover"):
                arm.recover()
            sdk.modes.be("Idle")
        arm.recover()
        arm.execute(rad(arm.state().q_rad))
        names = [name for name, _ in sdk.calls]
        felt, *before = [name for name in names if name in SETTERS]
        assert (felt, before) == ("set_load", list(SETTERS)), "the load is felt once, then everything is set"


@pytest.mark.long
@pytest.mark.parametrize(
    ("brought_about", "ended", "words"),
    [
        ("mode Reflex", None, "joint_reflex"),
        ("press", "release", "the stop button is pressed"),
        ("guide", "let-go", "let go of its buttons"),
        ("lock", "unlock", "unlock the joints"),
    ],
)
def test_an_fr3_found_in_any_mode_connects_explains_recovers_and_moves(
    server: Fr3Process, brought_about: str, ended: str | None, words: str
) -> None:
    before = len(server.configured())
    server.tell(brought_about)
    with franka(cell("fr3"), FrankaSettings(server.host), RELAXED) as arm:
        assert words in (arm.state().fault or "")
        if ended is not None:
            with pytest.raises(ArmFault, match="recover"):
                arm.recover()
            server.tell(ended)
        arm.recover()
        assert not server.configured()[before:], "nothing is set before a motion is asked for"
        for _ in range(2):
            arm.execute(rad(arm.state().q_rad))
        felt, *every = server.configured()[before:]
        assert (felt, every) == ("set_load", 2 * list(SETTERS)), "the load is felt once, all is set before each motion"


def test_the_stop_button_pressed_between_the_check_and_the_motion_moves_nothing() -> None:
    sdk = FakeSdk(k=True)
    driver = driver_of(sdk)
    checked_s = driver.reading().at_s
    sdk.modes.pressed = True
    with pytest.raises(Failure, match=r"the stop button is pressed .*nothing has moved") as raised:
        driver.prepare(checked_s)
    assert raised.value.kind == UNMOVED
    assert not any(name in (*SETTERS, "command") for name, _ in sdk.calls)


class Moved(InProcess):
    """Somebody moves the arm after the program has checked the motion, before the player begins it."""

    by_rad = 0.0

    def play(self, *arguments: Any, **more: Any) -> PlayOutcome:
        self.driver._robot._q[1] += self.by_rad
        self.by_rad = 0.0
        return super().play(*arguments, **more)


@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize("by_rad", [0.05, 0.0005, -0.002])
def test_an_arm_that_was_moved_after_the_check_is_not_commanded(model: str, by_rad: float) -> None:
    sdk = FakeSdk(k=model == "panda")
    with arm_of(sdk, model, player=Moved) as arm:
        assert isinstance(arm._player, Moved)
        arm._player.by_rad = by_rad
        before = arm.state().q_rad
        with pytest.raises(ArmFault, match=r"joint 2 .*nothing has"):
            arm.execute(rad(before))
        moved = before + by_rad * (np.arange(7) == 1)
        commands = [q for name, (q, _) in (call for call in sdk.calls if call[0] == "command")]
        assert len(commands) == 1, "one command, which ends the motion where the arm is"
        np.testing.assert_allclose(commands[0], moved, atol=1e-12)
        with pytest.raises(ArmFault, match="recover"):
            arm.execute(rad(arm.state().q_rad))
        arm.recover()
        arm.execute(rad(arm.state().q_rad))


def test_what_limits_rates_chases_a_jump_and_what_does_not_is_refused_it() -> None:
    """Why the Panda is driven without libfranka's limiter: 50 mrad become more than 1 rad/s."""
    chased, robot = [], FakeRobot(FakeSdk(k=True))
    goal = np.array(robot._q) + 0.05 * (np.arange(7) == 0)

    def command(state: Any, since: Any) -> JointPositions:
        chased.append(list(state.q))
        answer = JointPositions(goal.tolist())
        answer.motion_finished = len(chased) > 200
        return answer

    robot.control_joint_position(command, limit_rate=True)
    assert np.abs(np.diff(chased, axis=0)).max() * 1e3 > 1.0
    refused = FakeRobot(FakeSdk(k=True))
    with pytest.raises(RuntimeError, match="reflex"):
        refused.control_joint_position(command, limit_rate=False)
    assert refused.sdk.modes.reasons == ("joint_position_motion_generator_start_pose_invalid",)


def test_the_stand_in_and_the_sdk_send_no_command_that_is_not_finite(server: Fr3Process) -> None:
    import pylibfranka  # noqa: PLC0415

    real = pylibfranka.Robot(server.host, pylibfranka.RealtimeConfig.kIgnore)
    sdks: list[tuple[Any, Any]] = [(FakeRobot(FakeSdk(k=False)), JointPositions), (real, pylibfranka.JointPositions)]
    for robot, joints in sdks:
        control = robot.start_joint_position_control(_mode(robot))
        control.readOnce()
        with pytest.raises(ValueError, match=f"^{NOT_FINITE}$"):
            control.writeOnce(joints([float("nan"), *READY_RAD[1:].tolist()]))


def test_a_motion_that_begins_late_does_not_begin() -> None:
    sdk = FakeSdk(k=True)
    driver = driver_of(sdk)
    motion = motion_of(rad(np.array(sdk.q_rad)), cell("panda").motion)
    clock = iter([0.0, 1.5])
    playback = Playback(motion, lambda: "", lambda: 0.0, awake=lambda: next(clock))
    driver.drive(playback.step)
    assert playback.refused == "the arm took 1.5 s to begin the motion (at most 1 s)"
    assert len([name for name, _ in sdk.calls if name == "command"]) == 1


def test_a_stop_button_pressed_between_check_and_motion_needs_a_recovery_after_its_release() -> None:
    sdk = FakeSdk(k=True)

    class Pressed(InProcess):
        def play(self, *arguments: Any, **more: Any) -> PlayOutcome:
            sdk.modes.pressed = True
            return super().play(*arguments, **more)

    with arm_of(sdk, player=Pressed) as arm:
        path = rad(arm.state().q_rad)
        for _ in range(2):  # as it is pressed, and once more after its release
            with pytest.raises(ArmFault, match="stop button"):
                arm.execute(path)
            sdk.modes.pressed = False
        assert not any(name == "command" for name, _ in sdk.calls)
        arm.recover()
        sdk.modes.pressed = True
        with pytest.raises(ArmFault, match="stop button"):
            arm.execute(path)  # pressed before the check


def test_a_stop_during_a_recovery_holds() -> None:
    sdk = FakeSdk(k=True)

    class Stopping(InProcess):
        def recover(self) -> Reading:
            reading = super().recover()
            if len(stopped) < 1:
                arm.stop()
                stopped.append(None)
            return reading

    stopped: list[None] = []

    with arm_of(sdk, player=Stopping) as arm:
        sdk.modes.be("Reflex")
        arm.recover()
        with pytest.raises(ArmFault, match="requested"):
            arm.execute(rad(arm.state().q_rad))
        arm.recover()
        arm.execute(rad(arm.state().q_rad))


def test_a_motion_of_somebody_else_is_waited_for_and_then_said() -> None:
    sdk = FakeSdk(k=False)
    sdk.modes.moving = True
    driver = driver_of(sdk, "fr3")
    checked_s = driver.reading().at_s
    with pytest.raises(Failure, match="not asked"):
        driver.prepare(checked_s)


def test_a_recovery_that_asks_for_a_person_first_says_what_to_do(server: Fr3Process) -> None:
    server.tell("mode Reflex")
    server.tell("manual")
    with franka(cell("fr3"), FrankaSettings(server.host), RELAXED) as arm:
        with pytest.raises(ArmFault, match="guide"):
            arm.recover()
        arm.recover()
        assert arm.state().fault is None


@pytest.mark.long
def test_fci_that_is_off_is_a_message_and_the_next_call_connects_again(server: Fr3Process) -> None:
    with franka(cell("fr3"), FrankaSettings(server.host), RELAXED) as arm:
        server.tell("fci off")
        with pytest.raises(DeviceUnavailable):
            for _ in range(10_000):  # states that were under way still arrive
                arm.state()
        with pytest.raises(DeviceUnavailable, match="activate FCI in Desk"):
            arm.state()
        server.tell("fci on")
        assert arm.state().fault is None


def jump(name: str, size: float) -> Callable[[np.ndarray], np.ndarray]:
    """A path whose joint 1 breaks one limit of the arm 0.3 s into it, and no other before."""
    t_s = np.arange(600) / 1000.0
    past_s = np.maximum(t_s - 0.3, 0.0)
    shape = {
        "joint_motion_generator_acceleration_discontinuity": past_s * (past_s + 0.001) / 2.0,
        "joint_motion_generator_velocity_discontinuity": past_s,
    }[name]
    return lambda q_rad: q_rad + size * shape[:, None] * (np.arange(7) == 0)


@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("joint_motion_generator_acceleration_discontinuity", 7.6),
        ("joint_motion_generator_velocity_discontinuity", 0.1),
    ],
)
def test_an_arm_notices_what_no_checked_path_does(model: str, name: str, size: float) -> None:
    sdk = FakeSdk(k=model == "panda")
    driver = driver_of(sdk, model)
    rows = iter(jump(name, size)(np.array(sdk.q_rad)))
    with pytest.raises(Failure, match=name):
        driver.drive(lambda state, dt_s: (next(rows).tolist(), False))


@pytest.mark.long
def test_lost_commands_are_bridged_and_twenty_in_a_row_are_a_reflex(server: Fr3Process) -> None:
    server.tell("lose 0.2 5")
    with franka(cell("fr3"), FrankaSettings(server.host), RELAXED) as arm:
        path = rad(arm.state().q_rad)
        assert arm.execute(path).control_success_rate < 1.0
        server.tell("lose 0.2 20")
        with pytest.raises(ArmFault, match="communication_constraints_violation"):
            arm.execute(rad(arm.state().q_rad))
