"""An FR3 that speaks the maker's network protocol: franky-sim's server and MuJoCo arm, made a little stricter.

Runs as a process of its own: `python fr3_server.py HOST INTERFACE PACE q1 ... q7`. It says "ready" on stdout and
then obeys lines on stdin, each answered by "done":

    place q1 ... q7          be there, at rest, with nothing left of what happened before
    reflex SECONDS NAME ...  raise these so long into the next motion
    flags INDEX ...          report these error flags, by their place on the wire, from now on
    manual                   the next recovery asks for a person first
    mode NAME                be in that mode, by whatever brings it about (tests/support/franka_modes.py)
    lose SECONDS CYCLES      so many commands in a row are lost, or too late, so long into the next motion
    strict CYCLES            from now on so many cycles in a row without a command are a reflex, as 20 on the arm
    patient                  no number of such cycles is
    press, release           the stop button
    guide, let-go            the buttons at the hand
    lock, unlock             the joints, in Desk
    hand MASS                the end effector that is set in Desk weighs so many kg
    model NAME               the arm describes itself as that model, with its masses
    deaf, all-ears           a load is accepted and not taken; it is taken again
    fci off, fci on          nobody answers any more; somebody does
    mark SECONDS AFTER       write a line to stderr so long into the next motion but AFTER
    report                   the commands of the last motion, and whether it goes on, as JSON

Nothing pushes on the arm: it reports external torques of noise, ripple and a constant error.

Added to franky-sim: what the arm takes in which mode, what it finds wrong with commanded joints and with lost ones, the
torque that they need, reflexes with their reasons, recovery that takes its time, the success rate of the last 100
cycles, and an interface version of choice. PACE "exact" keeps to 1 kHz and loses the
commands that come late; "patient" waits for the command of every cycle, so that a test does not depend on the load of
the computer; "hurried" waits too, and goes on as soon as it came. After a mark it dawdles until the motion is over, so
that what a test does there always falls into it.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import franky_sim.franka_server as base
import numpy as np
from arm_urdf import described
from franka_modes import FLAGS, LOST_IN_A_ROW, MODES, STOP_PRESSED, ArmModes, Monitor
from franky_sim.franka_robot_protocol import (
    COMMAND_PORT,
    FR3_URDF,
    AutomaticErrorRecoveryCommand,
    AutomaticErrorRecoveryStatus,
    GetRobotModelCommand,
    MoveCommand,
    MoveStatus,
    RobotCommand,
    RobotMode,
    SetCollisionBehaviorCommand,
    SetJointImpedanceCommand,
    SetLoadCommand,
    UDPCommand,
)
from franky_sim.franka_robot_server import FrankaRobotServer
from franky_sim.mujoco_simulator import MujocoSimulator
from torque_errors import estimate_errors_Nm

PATIENCE_S = 0.2
RECOVERY_CYCLES = 50
DAWDLING_S = 0.01
"""A cycle's length after a mark."""
TORQUE_ERROR_NM = 0.8
HAND_KG = 0.73
KP = (4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0)
KV = (100.0, 100.0, 70.0, 70.0, 20.0, 20.0, 20.0)


class Recovery(AutomaticErrorRecoveryCommand):
    def handle(self, server: Any) -> None:
        modes: ArmModes = server.modes
        if (refusal := modes.refusal("recover")) is not None:
            modes.by_hand_first = False  # the person whom it asks for does it now
            self.reply(refusal.status("recover"))
        elif modes.mode == "Reflex":
            modes.recovering, server.recovers, server.recovery_cycles = True, self, RECOVERY_CYCLES
        else:
            self.reply(AutomaticErrorRecoveryStatus.kSuccess)


class Describing(GetRobotModelCommand):
    def handle(self, server: Any) -> None:
        self.reply(0, payload=server.urdf.encode("ascii"))


class Moving(MoveCommand):
    def handle(self, server: Any) -> None:
        refusal = server.modes.refusal("move")
        if refusal is None:
            super().handle(server)
        else:
            self.reply(refusal.status("move"))


def setter(name: str, kind: type[base.BaseCommand]) -> type[base.BaseCommand]:
    """The command, taken in the modes in which an arm takes it, and kept."""

    class Setter(kind):
        def handle(self, server: Any) -> None:
            if (refusal := server.modes.refusal(name)) is not None:
                self.reply(refusal.status(name))
            elif name == "set_load" and server.deaf:
                self.reply(0)
            else:
                server.configured.append(name)
                super().handle(server)

    return Setter


class Fr3Server(FrankaRobotServer):
    """`moving` counts the cycles of the present motion; `received` keeps the commanded joints, None where none came."""

    def __init__(self, robot: Any, host: str) -> None:
        super().__init__(robot, [host])
        self._FrankaServer__command_class_map |= {
            RobotCommand.kAutomaticErrorRecovery: Recovery,
            RobotCommand.kMove: Moving,
            RobotCommand.kGetRobotModel: Describing,
            RobotCommand.kSetLoad: setter("set_load", SetLoadCommand),
            RobotCommand.kSetJointImpedance: setter("set_joint_impedance", SetJointImpedanceCommand),
            RobotCommand.kSetCollisionBehavior: setter("set_collision_behavior", SetCollisionBehaviorCommand),
        }
        self.modes, self.monitor = ArmModes(), Monitor("fr3")
        self.urdf: str = FR3_URDF
        self.shown_flags: tuple[int, ...] = ()
        self.configured: list[str] = []  # since the last motion began, and before it
        self.recovers: Recovery | None = None
        self.recovery_cycles = 0
        self.planned: tuple[float, tuple[str, ...]] | None = None
        self.losing = (0.0, 0)  # seconds into the next motion, cycles
        self.strict, self.fci = False, True
        self.deaf, self.hand_kg = False, HAND_KG
        self.orders: deque[Callable[[], None]] = deque()  # for the thread that simulates
        self.moving = 0
        self.received: list[list[float] | None] = []
        self.recent: deque[bool] = deque(maxlen=100)
        self.mark_s, self.mark_after, self.is_marked = 0.0, 0, False
        self.external_Nm, self.rng = np.zeros(7), np.random.default_rng(0)
        self._came: list[float] | None = None
        self._answered, self._dropped = 0, False

    def _bind_children(self, hostname: str) -> None:
        """The hand is `gripper_server.py`: franky-sim's takes one connection and answers no stopped command."""

    def start_motion(self, *mode: Any) -> None:
        self.moving, self.received, self.is_marked = 0, [], False
        self.mark_after -= 1
        self.recent.clear()
        self.monitor.begin(np.array(self.robot.state.q_d))
        self.modes.moving = True
        held = tuple(self.robot.state.q_d)
        super().start_motion(*mode)
        # until the first command an arm goes on holding its last q_d (control_parameters.rst of the maker's FCI
        # documentation: a trajectory begins at "the most recent q_d"); franky-sim would hold the measured joints
        self._FrankaRobotServer__current_control_command = UDPCommand(q_c=held)

    def stop_motion(self, *arguments: Any, **more: Any) -> None:
        self.modes.moving = False
        super().stop_motion(*arguments, **more)

    def _reset_state(self) -> None:
        super()._reset_state()
        self.modes.moving = False

    def _handle_udp_command(self, command_data: bytes) -> None:
        (answers,) = struct.unpack_from("<Q", command_data)  # the state that it answers
        if answers != self._answered + 1 and not self.strict:
            self.monitor.gap()  # the computer of the test was slow, which is not what the test is about
        self._answered = answers
        self._dropped = self._due(self.losing)
        if self._dropped:
            return
        self._came = list(struct.unpack_from("<7d", command_data, 8))
        super()._handle_udp_command(command_data)

    def _due(self, when: tuple[float, int]) -> bool:
        since = self.moving - 1000 * when[0]
        return bool(self.current_motion_id) and 0 <= since < when[1]

    def _post_process_commands(self) -> None:
        if self.current_motion_id:
            self.moving += 1
            self.received.append(self._came)
            self.recent.append(self._came is not None)
            if self.mark_s and self.mark_after < 0 and self.moving >= self.mark_s * 1000:
                self.mark_s, self.is_marked = 0.0, True
                sys.stderr.write("mark\n")
                sys.stderr.flush()
            self._check()
        self._recover()
        self._came, self._dropped = None, False
        super()._post_process_commands()

    def _check(self) -> None:
        """Whatever ends the motion: what a test wants, the stop button, what touches, and what is commanded."""
        came, wrong = self._came, tuple[str, ...]()
        if came is not None:
            wrong = self.monitor.cycle(np.array(came))
        elif self.strict or self._dropped or self._due(self.losing):
            wrong = self.monitor.cycle(None)
        else:
            self.monitor.gap()
        if self.modes.pressed:
            self.abort((), MoveStatus(STOP_PRESSED.status("move")))
        elif self.planned and self.moving >= self.planned[0] * 1000:
            self.abort(self.planned[1], MoveStatus.kReflexAborted)
            self.planned = None
        elif wrong:
            self.abort(wrong, MoveStatus.kReflexAborted)

    def _recover(self) -> None:
        if self.recovers is None:
            return
        self.recovery_cycles -= 1
        if self.modes.pressed:
            self.recovers.reply(STOP_PRESSED.status("recover"))
        elif self.recovery_cycles > 0:
            return
        else:
            self.modes.reasons = ()
            self.recovers.reply(AutomaticErrorRecoveryStatus.kSuccess)
        self.modes.recovering, self.recovers = False, None

    def abort(self, reasons: tuple[str, ...], status: MoveStatus) -> None:
        motion = self.current_motion_id
        self.stop_motion(send_preemption_signal=False)
        self.reset_current_motion_id()
        self.modes.reasons = reasons
        base.BaseCommand.send_response(self._tcp_socket, RobotCommand.kMove, motion, status)

    @property
    def robot_state(self) -> Any:
        state = super().robot_state
        mode = RobotMode(MODES.index(self.modes.mode))
        flags = tuple(i in self.shown_flags or name in self.modes.reasons for i, name in enumerate(FLAGS))
        rate = float(np.mean(self.recent)) if self.current_motion_id and self.recent else 0.0
        felt = {"tau_ext_hat_filtered": tuple(self.external_Nm.tolist()), "O_F_ext_hat_K": (0.0,) * 6}
        return state.replace(
            robot_mode=mode,
            errors=flags,
            reflex_reason=flags,
            control_command_success_rate=rate,
            m_ee=self.hand_kg,
            **felt,
        )

    def feel(self) -> None:
        """Estimate the external torques anew."""
        q_rad = np.array([self.robot.data.qpos[at] for at in self.robot._qpos_addrs])
        self.external_Nm = TORQUE_ERROR_NM + estimate_errors_Nm(q_rad, self.rng)

    def take_place(self, q_rad: list[float]) -> None:
        """Be there, at rest, with nothing left of what happened before."""
        arm = self.robot
        for q, position, velocity in zip(q_rad, arm._qpos_addrs, arm._dof_addrs, strict=True):
            arm.data.qpos[position], arm.data.qvel[velocity] = q, 0.0
        self._FrankaRobotServer__holding_q = tuple(q_rad)
        self.modes.be("Idle")
        self.planned, self.shown_flags, self.strict, self.monitor.most_lost = None, (), False, LOST_IN_A_ROW
        self.losing, self.deaf, self.hand_kg = (0.0, 0), False, HAND_KG

    def be_strict(self, most_lost: int) -> None:
        self.strict, self.monitor.most_lost = True, most_lost

    def turn_fci(self, word: str) -> None:
        """Activated in Desk, or not: then nobody listens."""
        self.fci = word == "on"
        if self.fci:
            again = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            again.bind((self.hostname, COMMAND_PORT))
            again.listen(1)
            again.setblocking(False)
            self._FrankaServer__server_socket = again
        else:
            self.reset_state()
            self._FrankaServer__server_socket.close()

    def take_orders(self) -> None:
        while self.orders:
            self.orders[0]()
            self.orders.popleft()

    def wait_for_command(self) -> None:
        if self.udp_connected and self.current_motion_id:
            select.select([self._FrankaServer__udp_socket, self._tcp_socket], [], [], PATIENCE_S)


def speak(interface: int) -> None:
    """Answer with another interface version, and refuse, as an arm with another system does."""

    def refuse(self: Any, server: Any, command_type_struct: str = "I") -> None:
        header = base.MessageHeader(self.command_type, self.command_id, 8).to_bytes(command_type_struct)
        self.client_socket.sendall(header + struct.pack("<BH5x", 1, interface))

    if interface != 10:
        base.ConnectCommand.handle = refuse


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def obey(server: Fr3Server) -> None:
    for line in sys.stdin:
        word, *rest = line.split()
        if (order := order_of(server, word, rest)) is not None:
            server.orders.append(order)
            while server.orders:
                time.sleep(0.001)
        elif word == "report":
            moves = bool(server.current_motion_id)
            say(json.dumps({"received": server.received, "configured": server.configured, "moves": moves}))
        say("done")


def order_of(server: Fr3Server, word: str, rest: list[str]) -> Callable[[], None] | None:
    """What a line asks for. Raises KeyError for a word that is none."""

    def keep(name: str, value: Any, of: Any = server) -> Callable[[], None]:
        return lambda: setattr(of, name, value)

    modes = server.modes
    flags = {
        "press": ("pressed", True),
        "release": ("pressed", False),
        "guide": ("guided", True),
        "let-go": ("guided", False),
        "lock": ("locked", True),
        "unlock": ("locked", False),
        "manual": ("by_hand_first", True),
    }
    if word in flags:
        return keep(*flags[word], modes)
    orders: dict[str, Callable[[], Callable[[], None] | None]] = {
        "place": lambda: lambda: server.take_place([float(v) for v in rest]),
        "mode": lambda: lambda: modes.be(rest[0]),
        "fci": lambda: lambda: server.turn_fci(rest[0]),
        "reflex": lambda: keep("planned", (float(rest[0]), tuple(rest[1:]))),
        "flags": lambda: keep("shown_flags", tuple(map(int, rest))),
        "hand": lambda: keep("hand_kg", float(rest[0])),
        "model": lambda: keep("urdf", described(FR3_URDF, rest[0])),
        "deaf": lambda: keep("deaf", True),
        "all-ears": lambda: keep("deaf", False),
        "lose": lambda: keep("losing", (float(rest[0]), int(rest[1]))),
        "strict": lambda: lambda: server.be_strict(int(rest[0])),
        "patient": lambda: keep("strict", False),
        "mark": lambda: lambda: (keep("mark_after", int(rest[1]))(), keep("mark_s", float(rest[0]))())[0],
        "report": lambda: None,
    }
    return orders[word]()


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
            server.take_orders()
            if server.fci:
                server.process_commands()
            else:  # nobody is listened to, and the joints are held all the same
                server._post_process_commands()
            server.feel()
            sim.step()
            server.send_state()
            if pace != "exact":
                server.wait_for_command()
            if pace == "hurried" and server.current_motion_id:
                time.sleep(DAWDLING_S if server.is_marked else 0.0)
                continue
            due_s = max(due_s + 0.001, time.perf_counter() - 0.001)  # a late cycle is not made up for in a burst
            time.sleep(max(0.0, due_s - time.perf_counter()))


if __name__ == "__main__":
    main(*sys.argv[1:])
