"""An FR3 that speaks the maker's network protocol: franky-sim's server and MuJoCo arm, made a little stricter.

Runs as a process of its own: `python fr3_server.py HOST INTERFACE PACE q1 ... q7`. It says "ready" on stdout and
then obeys lines on stdin, each answered by "done":

    place q1 ... q7          be there, at rest
    reflex SECONDS NAME ...  raise these so long into the next motion
    strict CYCLES            from now on so many cycles in a row without a command are a reflex, as on the arm
    press, release           the stop button
    mark SECONDS AFTER       write a line to stderr so long into the next motion but AFTER
    plane HEIGHT STIFFNESS NOISE X Y Z   a level, springy plane under the flange's point X Y Z, in m, N/m and Nm
    threshold FORCE          the plane's force in N at which the arm stops by itself
    report                   the commands of the last motion, as JSON

The plane pushes on the simulated arm, and the arm reports what it does to its joints, with noise and a constant error.

Added to franky-sim: reflexes with their reasons, a motion that is refused before they are cleared, the stop button, the
success rate of the last 100 cycles, and an interface version of choice. PACE "exact" keeps to 1 kHz and loses the
commands that come late; "patient" waits for the command of every cycle, so that a test does not depend on the load of
the computer; "hurried" waits too, and goes on as soon as it came.
"""

from __future__ import annotations

import json
import select
import struct
import sys
import threading
import time
from collections import deque
from typing import Any

import franky_sim.franka_server as base
import numpy as np
from franky_sim.franka_robot_protocol import (
    AutomaticErrorRecoveryCommand,
    AutomaticErrorRecoveryStatus,
    MoveStatus,
    RobotCommand,
    RobotMode,
)
from franky_sim.franka_robot_server import FrankaRobotServer
from franky_sim.mujoco_simulator import MujocoSimulator

from hw.kinematics import forward, jacobian

# Order of libfranka's error flags on the wire.
REFLEXES = {"joint_position_limits_violation": 0, "joint_reflex": 6, "cartesian_reflex": 7} | {
    "communication_constraints_violation": 25
}
PATIENCE_S = 0.2
TORQUE_ERROR_NM = 0.8
KP = (4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0)
KV = (100.0, 100.0, 70.0, 70.0, 20.0, 20.0, 20.0)


class Plane:
    """A level plane that presses back where a point fixed to the flange is below it."""

    def __init__(self, height_m: float, stiffness_N_m: float, noise_Nm: float, p_F_m: Any) -> None:
        self._height_m, self._stiffness_N_m, self._noise_Nm, self._p_F_m = height_m, stiffness_N_m, noise_Nm, p_F_m
        self._rng = np.random.default_rng(0)
        self.force_N, self.reported_Nm = 0.0, np.zeros(7)

    def act(self, q_rad: Any) -> Any:
        """Joints (7,) -> torques (7,) on them; what the arm takes them to be goes into `reported_Nm`."""
        X_BF = forward(q_rad)
        deep_m = self._height_m - float((X_BF[:3, :3] @ self._p_F_m + X_BF[:3, 3])[2])
        self.force_N = max(deep_m, 0.0) * self._stiffness_N_m
        torque_Nm = self.force_N * jacobian(q_rad, self._p_F_m)[2]
        self.reported_Nm = torque_Nm + TORQUE_ERROR_NM + self._noise_Nm * self._rng.standard_normal(7)
        return torque_Nm


class Recovery(AutomaticErrorRecoveryCommand):
    def handle(self, server: Any) -> None:
        server.reasons = ()
        self.reply(AutomaticErrorRecoveryStatus.kSuccess)


class Fr3Server(FrankaRobotServer):
    """`moving` counts the cycles of the present motion; `received` keeps the commanded joints, None where none came."""

    def __init__(self, robot: Any, host: str) -> None:
        super().__init__(robot, [host])
        self._FrankaServer__command_class_map[RobotCommand.kAutomaticErrorRecovery] = Recovery
        self.reasons: tuple[str, ...] = ()
        self.pressed = False
        self.planned: tuple[float, tuple[str, ...]] | None = None
        self.most_missed = sys.maxsize
        self.place: list[float] | None = None
        self.moving, self.missed = 0, 0
        self.received: list[list[float] | None] = []
        self.recent: deque[bool] = deque(maxlen=100)
        self.mark_s, self.mark_after = 0.0, 0
        self.plane = Plane(-1.0, 0.0, 0.0, np.zeros(3))
        self.threshold_N = float("inf")
        self._came: list[float] | None = None

    def start_motion(self, *mode: Any) -> None:
        if self.reasons or self.pressed:
            raise RuntimeError("not before the recovery")  # franky-sim answers that the motion is aborted
        self.moving, self.missed, self.received = 0, 0, []
        self.mark_after -= 1
        self.recent.clear()
        super().start_motion(*mode)

    def _handle_udp_command(self, command_data: bytes) -> None:
        self._came = list(struct.unpack_from("<7d", command_data, 8))
        super()._handle_udp_command(command_data)

    def _post_process_commands(self) -> None:
        if self.current_motion_id:
            self.moving += 1
            self.received.append(self._came)
            self.recent.append(self._came is not None)
            if self.mark_s and self.mark_after < 0 and self.moving >= self.mark_s * 1000:
                self.mark_s = 0.0
                sys.stderr.write("mark\n")
                sys.stderr.flush()
            self.missed = 0 if self._came else self.missed + 1
            if self.planned and self.moving >= self.planned[0] * 1000:
                self.abort(self.planned[1], MoveStatus.kReflexAborted)
                self.planned = None
            elif self.plane.force_N > self.threshold_N:
                self.abort(("cartesian_reflex",), MoveStatus.kReflexAborted)
            elif self.missed >= self.most_missed:
                self.abort(("communication_constraints_violation",), MoveStatus.kReflexAborted)
            elif self.pressed:
                self.abort((), MoveStatus.kEmergencyAborted)
        self._came = None
        super()._post_process_commands()

    def abort(self, reasons: tuple[str, ...], status: MoveStatus) -> None:
        motion = self.current_motion_id
        self.stop_motion(send_preemption_signal=False)
        self.reset_current_motion_id()
        self.reasons = reasons
        base.BaseCommand.send_response(self._tcp_socket, RobotCommand.kMove, motion, status)

    @property
    def robot_state(self) -> Any:
        state = super().robot_state
        mode = RobotMode.kUserStopped if self.pressed else RobotMode.kReflex if self.reasons else state.robot_mode
        flags = tuple(i in {REFLEXES[name] for name in self.reasons} for i in range(41))
        rate = float(np.mean(self.recent)) if self.current_motion_id and self.recent else 0.0
        felt = {"tau_ext_hat_filtered": tuple(self.plane.reported_Nm.tolist())}
        return state.replace(
            robot_mode=mode, errors=flags, reflex_reason=flags, control_command_success_rate=rate, **felt
        )

    def push(self) -> None:
        """Let the plane act on the joints, on top of what the controller asks of them."""
        arm = self.robot
        torque_Nm = self.plane.act(np.array([arm.data.qpos[at] for at in arm._qpos_addrs]))
        for at, torque in zip(arm._dof_addrs, torque_Nm, strict=True):
            arm.data.qfrc_applied[at] += torque

    def take_place(self) -> None:
        """Be where the test wants the arm, at rest, with nothing left of what happened before."""
        if self.place is not None:
            arm = self.robot
            for q, position, velocity in zip(self.place, arm._qpos_addrs, arm._dof_addrs, strict=True):
                arm.data.qpos[position], arm.data.qvel[velocity] = q, 0.0
            self._FrankaRobotServer__holding_q = tuple(self.place)
            self.reasons, self.pressed, self.planned, self.place = (), False, None, None
            self.threshold_N = float("inf")

    def wait_for_command(self) -> None:
        if self.udp_connected and self.current_motion_id:
            select.select([self._FrankaServer__udp_socket, self._tcp_socket], [], [], PATIENCE_S)


def speak(interface: int) -> None:
    """Answer with another interface version, and refuse, as an arm with another system does."""

    def refuse(self: Any, server: Any, command_type_struct: str = "I") -> None:
        header = base.MessageHeader(self.command_type, self.command_id, 8).to_bytes(command_type_struct)
        self.client_socket.sendall(header + struct.pack("<BH5x", 1, interface))

    if interface != 10:
        base.ConnectCommand.handle = refuse  # type: ignore[method-assign]


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def obey(server: Fr3Server) -> None:
    for line in sys.stdin:
        word, *rest = line.split()
        if word == "reflex":
            server.planned = float(rest[0]), tuple(rest[1:])
        elif word == "strict":
            server.most_missed = int(rest[0])
        elif word in ("press", "release"):
            server.pressed = word == "press"
        elif word == "mark":
            server.mark_after = int(rest[1])
            server.mark_s = float(rest[0])
        elif word == "plane":
            height, stiffness, noise, *point = map(float, rest)
            server.plane = Plane(height, stiffness, noise, np.array(point))
        elif word == "threshold":
            server.threshold_N = float(rest[0])
        elif word == "report":
            say(json.dumps({"received": server.received}))
        elif word == "place":
            server.place = [float(v) for v in rest]
            while server.place is not None:
                time.sleep(0.001)
        say("done")


def main(host: str, interface: str, pace: str, *q: str) -> None:
    speak(int(interface))
    with MujocoSimulator() as sim:
        robot = sim.add_robot(initial_q=[float(v) for v in q], kp=KP, kv=KV)
        server = Fr3Server(robot, host)
        server.init()
        sim.start()
        threading.Thread(target=obey, args=(server,), daemon=True).start()
        say("ready")
        due_s = time.perf_counter()
        while True:
            server.take_place()
            server.process_commands()
            server.push()
            sim.step()
            server.send_state()
            if pace != "exact":
                server.wait_for_command()
            if pace == "hurried" and server.current_motion_id:
                continue
            due_s = max(due_s + 0.001, time.perf_counter() - 0.001)  # a late cycle is not made up for in a burst
            time.sleep(max(0.0, due_s - time.perf_counter()))


if __name__ == "__main__":
    main(*sys.argv[1:])
