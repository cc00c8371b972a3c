"""What can happen to a motion of the FR3, over its real network protocol."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import cell, move
from fr3_process import READY_RAD, RELAXED, Fr3Process, HandPedal, arm_at, fr3, own_host

from hw.errors import ArmFault, DeviceUnavailable, MotionRefused, StoppedByPedal
from hw.franka.arm import FrankaArm, franka, open_franka
from hw.franka.process import PlayerProcess, inspect
from hw.franka.settings import FrankaSettings, Payload
from hw.joint_limits import LIMITS, derivatives
from hw.types import Array, JointPath

SECOND = """
import sys
from hw.errors import DeviceUnavailable
from fr3_process import RELAXED
from hw.franka.arm import franka
from hw.franka.settings import FrankaSettings
from cells import cell
if __name__ == "__main__":
    try:
        franka(cell("fr3"), FrankaSettings(sys.argv[1]), RELAXED).__enter__()
    except DeviceUnavailable as error:
        print(error)
"""
CHANGE_RAD = np.array([0.4, -0.2, 0.2, 0.2, 0.3, 0.2, -0.4])


def path_from(q_rad: Array, change_rad: Array = CHANGE_RAD, duration_s: float = 1.5) -> JointPath:
    return move(change_rad, duration_s, start_rad=q_rad)


def pause(pid: int, seconds: float) -> None:
    os.kill(pid, signal.SIGSTOP)
    threading.Event().wait(seconds)
    os.kill(pid, signal.SIGCONT)


def pid_of_player(arm: FrankaArm) -> int:
    assert isinstance(arm._player, PlayerProcess)
    return arm._player.pid


def recovers_and_moves_only_when_told(arm: FrankaArm, reason: str) -> None:
    """A fault stays until `recover`, which moves nothing; the next motion plans from where the arm is."""
    stopped = arm.state()
    assert re.search(reason, stopped.fault or "")
    with pytest.raises(ArmFault, match="recover"):
        arm.execute(path_from(stopped.q_rad, -0.1 * CHANGE_RAD))
    arm.recover()
    still = arm.state()
    assert still.fault is None
    np.testing.assert_allclose(still.q_rad, stopped.q_rad, atol=1e-3)
    back = path_from(still.q_rad, -0.1 * CHANGE_RAD, 0.6)
    arm.execute(back)
    np.testing.assert_allclose(arm.state().q_rad, back.q_rad[-1], atol=3e-3)


@pytest.mark.long
def test_what_is_commanded_is_the_path_sample_by_sample(server: Fr3Process) -> None:
    path = path_from(READY_RAD)
    with arm_at(server) as arm:
        played = arm.execute(path)
        got = server.commanded()
        n = len(path.t_s)
        assert played.control_success_rate == 1.0
        np.testing.assert_allclose(played.q_commanded_rad[:n], path.q_rad, atol=2e-3)  # the arm hangs a little at first
        np.testing.assert_allclose(played.q_commanded_rad[500:n], path.q_rad[500:], atol=1e-12)
        np.testing.assert_allclose(got, played.q_commanded_rad[:-1], atol=1e-12)  # the last one ends the motion
        assert cell("fr3").check(JointPath(np.arange(len(got)) / 1000, got)).ok
        np.testing.assert_allclose(played.q_measured_rad[-1], path.q_rad[-1], atol=2e-3)


def test_a_path_that_starts_elsewhere_is_refused_with_the_threshold(server: Fr3Process) -> None:
    with arm_at(server) as arm:
        with pytest.raises(
            MotionRefused,
            match=r"distance from the arm of joint 6 .* is 0\.03\d* rad, limit 0\.01 rad",
        ):
            arm.execute(path_from(READY_RAD + 0.03 * (np.arange(7) == 5)))
        assert arm.state().fault is None
        np.testing.assert_allclose(arm.state().q_rad, READY_RAD, atol=1e-3)


@pytest.mark.long
def test_a_reflex_is_told_in_words_and_recovered_on_request_only(server: Fr3Process) -> None:
    server.tell("reflex 0.6 joint_reflex cartesian_reflex")
    with arm_at(server) as arm:
        with pytest.raises(ArmFault, match="cartesian_reflex"):
            arm.execute(path_from(READY_RAD))
        assert arm.last_execution is not None
        assert 0.5 < arm.last_execution.t_s[-1] < 0.7
        recovers_and_moves_only_when_told(arm, r"joint_reflex.*check what it touched")


@pytest.mark.long
def test_a_stop_request_brakes_along_the_path_within_the_limits(server: Fr3Process) -> None:
    path = path_from(READY_RAD)
    with arm_at(server) as arm:
        timer = server.at(0.5, arm.stop)
        with pytest.raises(ArmFault, match=r"a stop was requested .* the arm stood still after \d+ ms and \d+\.\d mm"):
            arm.execute(path)
        timer.join()
        got = server.commanded()
        limits = LIMITS["fr3"]
        dq, ddq, dddq = derivatives(got)
        ratios = limits.ratios(np.concatenate([got, np.repeat(got[-1:], 3, axis=0)]), dq, ddq)
        assert ratios.max() <= 1.0
        assert (np.abs(dddq) / limits.dddq_max_rad_s3).max() <= 1.0
        off = np.abs(path.q_rad[None, :, :] - got[500:, None, :]).max(axis=2).min(axis=1)
        assert off.max() < 2e-3  # on the path
        assert np.abs(got[-1] - path.q_rad[-1]).max() > 0.02  # and short of its end
        recovers_and_moves_only_when_told(arm, "stop was requested")


@pytest.mark.long
def test_letting_go_of_the_pedal_brakes_within_80_ms_and_says_how_far_it_went(server: Fr3Process) -> None:
    """The best of three, on the computer's clock: other work on the computer can only make it longer."""
    pedal = HandPedal()
    after_s: list[float] = []
    with arm_at(server, pedal=pedal) as arm:
        for _ in range(3):
            server.at(0.6, pedal.release)
            with pytest.raises(StoppedByPedal, match=r"pedal was released .* braking began after \d+ ms"):
                arm.execute(path_from(arm.state().q_rad, CHANGE_RAD / 2))
            stop = arm.last_stop
            assert stop is not None
            assert stop.why == "pedal"
            assert 0.0 < stop.braking_after_s <= 0.021
            assert stop.braking_after_s < stop.still_after_s < 0.5
            assert 0.0 < stop.way_m < 0.1
            after_s.append(stop.braked_clock_s - pedal.released_s)
            pedal.held = True
            recovers_and_moves_only_when_told(arm, "pedal")
            if after_s[-1] < 0.08:
                break
    assert 0.0 < min(after_s) < 0.08


def test_nothing_moves_unless_the_pedal_is_held(server: Fr3Process) -> None:
    pedal = HandPedal(held=False)
    with (
        arm_at(server, pedal=pedal) as arm,
        pytest.raises(MotionRefused, match="pedal"),
    ):
        arm.execute(path_from(READY_RAD))


@pytest.mark.long
def test_a_player_killed_half_way_is_a_fault_and_a_new_one_takes_over(server: Fr3Process) -> None:
    with arm_at(server) as arm:
        player = pid_of_player(arm)
        timer = server.at(0.6, lambda: os.kill(player, signal.SIGKILL))
        with pytest.raises(ArmFault, match="SIGKILL"):
            arm.execute(path_from(READY_RAD))
        timer.join()
        assert np.abs(arm.state().q_rad - READY_RAD).max() > 1e-3
        recovers_and_moves_only_when_told(arm, "killed by SIGKILL")
        assert pid_of_player(arm) != player


@pytest.mark.long
def test_a_player_that_stalls_is_stopped_by_the_arm_and_the_reason_is_the_computer(server: Fr3Process) -> None:
    server.tell("strict 5")
    with arm_at(server) as arm:
        player = pid_of_player(arm)
        timer = server.at(0.6, lambda: pause(player, 2.5))
        with pytest.raises(ArmFault, match="communication_constraints_violation"):
            arm.execute(path_from(READY_RAD))
        timer.join()
        server.tell("patient")
        recovers_and_moves_only_when_told(arm, "communication_constraints_violation")


@pytest.mark.long
def test_a_program_that_ends_lets_the_arm_brake(server: Fr3Process) -> None:
    script = Path(__file__).parents[2] / "support" / "moving_program.py"
    program = subprocess.Popen(
        [sys.executable, str(script), server.host], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    server.at(0.5, program.kill).join()
    program.communicate()
    seen: list[int] = []
    for _ in range(200):  # until no new commands come: the player has braked and ended
        seen.append(len(server.received()))
        if len(seen) > 10 and seen[-1] == seen[-10]:
            break
        threading.Event().wait(0.05)
    got = server.commanded()
    assert 50 < len(got) < 2500, "it did not play to the end"
    assert np.abs(np.diff(got[-20:], axis=0)).max() < 1e-9
    assert np.abs(derivatives(got)[1]).max() <= LIMITS["fr3"].ddq_max_rad_s2.max()


@pytest.mark.long
def test_a_pressed_stop_button_is_named_and_has_to_be_released_first(server: Fr3Process) -> None:
    with arm_at(server) as arm:
        timer = server.at(0.5, lambda: server.tell("press"))
        with pytest.raises(ArmFault, match="stopped"):
            arm.execute(path_from(READY_RAD))
        timer.join()
        assert "stop button" in (arm.state().fault or "") or arm.state().fault
        with pytest.raises(ArmFault, match="stop button"):
            arm.recover()
        server.tell("release")
        arm.recover()
        assert arm.state().fault is None


@pytest.mark.long
def test_an_arm_that_falls_silent_half_way_and_comes_back() -> None:
    with fr3() as server, arm_at(server) as arm:
        timer = server.at(0.6, lambda: server.signal(signal.SIGSTOP))
        with pytest.raises(ArmFault, match=r"does not answer .*check cable, address and power"):
            arm.execute(path_from(READY_RAD))
        timer.join()
        server.signal(signal.SIGCONT)
        recovers_and_moves_only_when_told(arm, "does not answer")


@pytest.mark.long
def test_a_second_program_on_this_computer_is_refused_and_the_first_goes_on(server: Fr3Process) -> None:
    """In another process, as a second command would be."""
    with arm_at(server) as arm:
        second = subprocess.run(
            [sys.executable, "-c", SECOND, server.host],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
        assert "another program on this computer is connected to the arm" in second.stdout, second
        path = path_from(arm.state().q_rad, -0.1 * CHANGE_RAD, 0.6)
        arm.execute(path)
    with arm_at(server) as arm:
        assert arm.state().fault is None, "the place is free again"


@pytest.mark.long
def test_an_arm_that_stands_still_between_check_and_motion_does_not_move(server: Fr3Process) -> None:
    """Settings have no time limit of their own: without one for the beginning, the motion was played 5 s late."""
    timing = replace(RELAXED, start_s=0.3)
    with arm_at(server, timing=timing) as arm:
        path = path_from(arm.state().q_rad, -0.1 * CHANGE_RAD, 0.6)
        assert arm._player is not None
        play = arm._player.play

        def frozen(*arguments: Any) -> Any:
            threading.Thread(target=pause, args=(server.pid, 0.7)).start()
            threading.Event().wait(0.05)
            return play(*arguments)

        arm._player.play = frozen  # type: ignore[method-assign, assignment]
        with pytest.raises(ArmFault, match=r"took \d\.\d s to begin the motion \(at most 0\.3 s\); nothing has moved"):
            arm.execute(path)


@pytest.mark.long
def test_a_connection_lost_for_good_is_a_fault_then_unavailable() -> None:
    with fr3() as server, arm_at(server) as arm:
        timer = server.at(0.6, lambda: server.signal(signal.SIGKILL))
        with pytest.raises(ArmFault, match="answer"):
            arm.execute(path_from(READY_RAD))
        timer.join()
        for use in (arm.state, arm.recover):
            with pytest.raises(DeviceUnavailable, match=r"refuses the connection: .*activate FCI in Desk"):
                use()


@pytest.mark.long
def test_another_interface_version_names_the_row_and_the_line_to_install() -> None:
    with (
        fr3(interface=5) as server,
        pytest.raises(
            DeviceUnavailable,
            match=r"interface version 5, pylibfranka 0\.21\.3 speaks 10 \(interface 5: .*pip install panda-python",
        ),
    ):
        arm_at(server).__enter__()


def test_nobody_there_is_a_message() -> None:
    with pytest.raises(DeviceUnavailable, match=r"fr3 at 127\.0\.0\.251 answers but refuses the connection"):
        franka(cell("fr3"), FrankaSettings("127.0.0.251"), RELAXED).__enter__()


@pytest.mark.skipif(Path("/sys/kernel/realtime").exists(), reason="this computer has a real-time kernel")
def test_without_a_real_time_kernel_a_real_arm_is_not_driven(server: Fr3Process) -> None:
    settings = FrankaSettings(server.host, Payload(0.2, np.array([0.0, 0.0, 0.1])))
    with pytest.raises(DeviceUnavailable, match=r"not a real-time one.*linux-image-rt-amd64"):
        open_franka(cell("fr3"), settings).__enter__()


@pytest.mark.long
def test_mode_joints_and_states_are_read_and_nothing_is_set(server: Fr3Process) -> None:
    before = server.configured()
    reading, rhythm, _ = inspect("fr3", FrankaSettings(server.host), realtime=False, states=200)
    assert reading.mode == "Idle"
    np.testing.assert_allclose(reading.q_rad, READY_RAD, atol=0.01)
    assert rhythm.states == 200
    assert rhythm.missed >= 0
    assert 0.0 < rhythm.longest_gap_s < 10.0
    assert server.configured() == before
    server.tell("press")
    stopped, _, _ = inspect("fr3", FrankaSettings(server.host), realtime=False, states=50)
    assert "the stop button is pressed" in str(stopped.unwilling)


def test_an_arm_that_is_not_there_is_said() -> None:
    with pytest.raises(DeviceUnavailable, match=r"answer|refuses"):
        inspect("fr3", FrankaSettings(own_host()), realtime=False)
