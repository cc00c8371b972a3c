"""The FR3 of the foreign lab: the maker's protocol by franky-sim, and a socket for the person and the camera in the
room.

    python arm.py HOST FOLDER [BOARD_PNG]

The camera and the person send requests to FOLDER/arm.sock, one JSON object per line: {"do": "hold", "what": "spatula"},
{"do": "put", ...}, {"do": "guide", "q": [...]}, {"do": "now"}, {"do": "since", "mark": n}, {"do": "truth"}.

A motion waits for the command of every cycle, so a busy computer makes the arm slow and not jerky. Time in a motion is
counted in its cycles, from the first command on; that is the clock of the arm's and the camera's stamps.
"""

from __future__ import annotations

import json
import queue
import select
import socket
import sys
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from franky_sim.franka_gripper_protocol import GripperCommandStatus
from franky_sim.franka_gripper_server import FrankaGripperServer, _MotionState
from franky_sim.franka_robot_server import FrankaRobotServer, UDPCommand
from franky_sim.franka_server import BaseCommand
from franky_sim.mujoco_simulator import FrankaMujocoRobot
from world import HELD, OBJECTS, START_RAD, TRUTH, Room

PATIENCE_S = 0.2
KEPT_MS = 90_000
TAIL_MS = 2100  # simulated at once after a motion, on the motion's clock: what was set moving comes to rest
REACHED_M, CLOSING_MS = 0.0003, 3000  # fingers this near to their goal, or that late, have stopped
IDLE_S = 0.01  # between cycles of an arm that stands
TORQUE_NOISE_NM = np.array([0.22, 0.32, 0.19, 0.31, 0.09, 0.11, 0.03])
TORQUE_ERROR_NM = np.array([0.3, -0.8, 0.4, 0.6, -0.2, 0.3, 0.1])
GRIP_M = {"nothing": 0.0, "board": 0.005, "spatula": 0.012, "pusher": 0.024}


class Arm:
    """The room, the protocol, and the history in steps of a millisecond."""

    def __init__(self, host: str, folder: Path, board: Path | None) -> None:
        self.room = Room(TRUTH, board, folder)
        self.robot = self.room.build(START_RAD)
        self._wrap_joints()
        self.held = "nothing"
        self.room.hold(self.held)
        self.server = Server(self.robot, host, self)
        self.server.init()
        self.orders: queue.Queue[tuple[dict[str, Any], queue.Queue[Any]]] = queue.Queue()
        self.history: deque[tuple[float, str, np.ndarray]] = deque(maxlen=KEPT_MS)
        self.count = 0
        self.motion_s: float | None = None  # when the present motion's first command came
        self.cycles = 0
        self.tail_ms = 0
        self._rng = np.random.default_rng(3)
        self._torque = np.zeros(7)

    def _wrap_joints(self) -> None:
        """Joints are reported without their zeros' errors, which nobody knows; fingers close onto what they hold."""
        robot, zero = self.robot, np.array(TRUTH.joint_zero_rad)
        inner, goal = robot._get_state, robot.set_hand_goal

        def reported() -> Any:
            state = inner()
            return type(state)(q=tuple(np.array(state.q) - zero), dq=state.dq, tau_j=state.tau_j)

        robot._get_state = reported
        robot.set_hand_goal = lambda width, *more: goal(max(width, GRIP_M[self.held]), *more)

    def now_s(self) -> float:
        return time.monotonic() if self.motion_s is None else self.motion_s + 0.001 * self.cycles

    def felt(self) -> np.ndarray:
        """(7,) torque of all contacts on the joints, filtered, with noise and a constant error."""
        model, data = self.room.model, self.room.data
        torque = np.zeros(model.nv)
        if data.nefc:
            force = data.efc_force.copy()
            force[data.efc_type < int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)] = 0.0
            mujoco.mj_mulJacTVec(model, data, torque, force)
        touch = np.array([torque[a] for a in self.robot._dof_addrs])
        self._torque += 0.2 * (touch - self._torque)  # the maker's filter
        return np.asarray(self._torque + TORQUE_ERROR_NM + TORQUE_NOISE_NM * self._rng.standard_normal(7))

    def cycle(self) -> None:
        self._obey()
        self.room.feel_patch()
        self.server.process_commands()
        self.room.step()
        self.server.reported_Nm = self.felt()
        if self.motion_s is not None:
            self.cycles += 1
        if self.tail_ms:
            self.tail_ms -= 1
            self.motion_s = self.motion_s if self.tail_ms else None
        self.history.append((self.now_s(), self.held, self.room.data.qpos.copy()))
        self.count += 1
        self.server.send_state()
        self.server.wait_for_command()

    @property
    def is_busy(self) -> bool:
        """Something moves: the arm, what it has pushed, or the fingers."""
        hand = self.server.gripper_server
        return bool(self.server.current_motion_id or self.tail_ms or (hand and hand.moves))

    def _obey(self) -> None:
        while not self.orders.empty() and not self.tail_ms:
            order, answer = self.orders.get()
            try:
                answer.put(self._do(order))
            except (KeyError, TypeError, ValueError) as error:
                answer.put({"error": f"{type(error).__name__}: {error}"})

    def _do(self, order: dict[str, Any]) -> dict[str, Any]:
        what = order["do"]
        if what == "hold":
            assert order["what"] in HELD
            self.held = order["what"]
            self.room.hold(self.held)
            self.robot.set_hand_goal(order.get("width", GRIP_M[self.held]), 0.1, 70.0)
            self.server.gripper_server._is_grasping = order.get("closed", False)
        elif what == "put":
            x_m, y_m = order["xy"]
            self.room.put(order["what"], x_m, y_m, order.get("yaw", 0.0))
        elif what == "guide":
            q = np.array(order["q"]) + np.array(TRUTH.joint_zero_rad)
            for value, position, velocity in zip(q, self.robot._qpos_addrs, self.robot._dof_addrs, strict=True):
                self.room.data.qpos[position], self.room.data.qvel[velocity] = value, 0.0
            self.server._FrankaRobotServer__holding_q = tuple(order["q"])
        elif what == "now":
            t, held, qpos = self.history[-1]
            return {"t": t, "held": held, "qpos": qpos.tolist(), "mark": self.count}
        elif what == "since":
            return {"states": self._since(order["mark"], order["every_s"])}
        elif what == "truth":
            return self._truth()
        return {}

    def _since(self, mark: int, every_s: float) -> list[Any]:
        """The states nearest to the moments of a camera that runs freely, since a mark."""
        new = list(self.history)[-(self.count - mark) :] if self.count > mark else []
        found, due = list[Any](), 0.0
        for t, held, qpos in new:
            if not found or t >= due:
                found.append((t, held, qpos.tolist()))
                due = (t if not found[:-1] or t - due > every_s else due) + every_s
        return found

    def _truth(self) -> dict[str, Any]:
        data = self.room.data
        names = ("flange", *HELD[1:], *OBJECTS)
        return {name: {"p": data.body(name).xpos.tolist(), "R": data.body(name).xmat.tolist()} for name in names}


class Hand(FrankaGripperServer):
    """franky-sim's hand, for two programs at once. A stop from either ends a motion that the other had begun."""

    def __init__(self, robot: FrankaMujocoRobot, host: str, first: Hand | None = None) -> None:
        super().__init__(robot, host)
        self._first, self._on_the_way = first, 0
        self._second = Hand(robot, host, self) if first is None else None

    def _check_motion_state(self) -> None:
        """As franky-sim's, whose fingers count as settled before they have begun to move."""
        is_far = abs(self._robot.hand_width - self._goal_width) > REACHED_M
        goes_there = self._motion_state in (_MotionState.MOVING, _MotionState.GRASPING)
        self._on_the_way = self._on_the_way + 1 if is_far and goes_there else 0
        if 0 < self._on_the_way < CLOSING_MS:
            self._settling_steps = 0
        super()._check_motion_state()

    @property
    def moves(self) -> bool:
        """Whether a command of either program is being done."""
        mine = self._motion_state is not _MotionState.IDLE
        return mine or (self._second is not None and self._second.moves)

    def init(self) -> None:
        super().init()
        assert self._second is not None
        self._second._FrankaServer__server_socket = self._FrankaServer__server_socket

    def process_commands(self) -> None:
        super().process_commands()
        if self._second is not None and self.tcp_connected:
            self._second.process_commands()

    def send_state(self) -> None:
        super().send_state()
        if self._second is not None:
            self._second.send_state()

    def stop(self, command_id: int, tcp_socket: socket.socket) -> None:
        other = self._first or self._second
        assert other is not None
        pending = (other._pending_tcp_socket, other._pending_command_type, other._pending_command_id)
        if None not in pending:
            aborted = GripperCommandStatus.kAborted
            BaseCommand.send_response(*pending, aborted, command_type_struct="H", status_type_struct="H")
        other._motion_state = _MotionState.IDLE
        other._pending_command_id = other._pending_tcp_socket = other._pending_command_type = None
        super().stop(command_id, tcp_socket)


class Server(FrankaRobotServer):
    """The server of franky-sim, with the torques of the room's contacts on the joints, and with longer time limits."""

    def __init__(self, robot: FrankaMujocoRobot, host: str, arm: Arm) -> None:
        super().__init__(robot, [host])
        self._arm = arm
        self.reported_Nm = np.zeros(7)

    def _bind_children(self, hostname: str) -> None:
        self._FrankaRobotServer__gripper_server = Hand(self._arm.robot, hostname)
        self.gripper_server.init()

    def start_motion(self, *mode: Any) -> None:
        held = tuple(self._arm.robot.state.q_d)
        super().start_motion(*mode)
        # until the first command the maker's arm holds its last q_d (FCI documentation, control parameters); franky-sim
        # would hold the measured joints
        self._FrankaRobotServer__current_control_command = UDPCommand(q_c=held)
        self._arm.motion_s, self._arm.cycles, self._arm.tail_ms = None, 0, 0

    def stop_motion(self, *arguments: Any, **more: Any) -> None:
        super().stop_motion(*arguments, **more)
        self._arm.tail_ms = TAIL_MS if self._arm.motion_s is not None else 0

    def _reset_state(self) -> None:
        super()._reset_state()
        self._arm.motion_s, self._arm.tail_ms = None, 0

    def _handle_udp_command(self, command_data: bytes) -> None:
        if self._arm.motion_s is None:
            self._arm.motion_s, self._arm.cycles = time.monotonic(), 0
        super()._handle_udp_command(command_data)

    @property
    def robot_state(self) -> Any:
        return super().robot_state.replace(tau_ext_hat_filtered=tuple(self.reported_Nm.tolist()))

    def wait_for_command(self) -> None:
        if self.udp_connected and self.current_motion_id:
            select.select([self._FrankaServer__udp_socket, self._tcp_socket], [], [], PATIENCE_S)


def listen(path: Path, arm: Arm) -> None:
    """Take orders at a socket, from any number of clients."""
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    path.unlink(missing_ok=True)
    server.bind(str(path))
    server.listen()
    while True:
        client, _ = server.accept()
        threading.Thread(target=answer, args=(client, arm), daemon=True).start()


def answer(client: socket.socket, arm: Arm) -> None:
    with client, client.makefile("rw") as file:
        for line in file:
            reply: queue.Queue[Any] = queue.Queue()
            arm.orders.put((json.loads(line), reply))
            file.write(json.dumps(reply.get()) + "\n")
            file.flush()


def web_page(host: str) -> None:
    """A web page of the arm that answers the doctor's requests."""
    try:
        server = socket.create_server((host, 443))
    except OSError:
        return
    while True:
        server.accept()[0].close()


def main(host: str, folder: str, board: str = "") -> None:
    arm = Arm(host, Path(folder), Path(board) if board else None)
    threading.Thread(target=listen, args=(Path(folder) / "arm.sock", arm), daemon=True).start()
    threading.Thread(target=web_page, args=(host,), daemon=True).start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    due_s = time.perf_counter()
    while True:
        arm.cycle()
        due_s = max(due_s + (0.001 if arm.is_busy else IDLE_S), time.perf_counter() - 0.001)
        time.sleep(max(0.0, due_s - time.perf_counter()))


if __name__ == "__main__":
    main(*sys.argv[1:])
