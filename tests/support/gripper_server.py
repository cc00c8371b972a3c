"""A Franka Hand that speaks the maker's network protocol (port 1338, version 3), at a loopback address of its own.

Several programs may be connected. Fingers move in real time. A stop aborts the command that runs, as libfranka's words
for it say; `deaf` leaves that command without an answer, as users report of hands, and `ignores` accepts stops and goes
on (libfranka's issues 18, 28, 52, 111).
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from fr3_process import own_host

PORT, VERSION, WIDEST_M = 1338, 3, 0.08
CONNECT, HOMING, GRASP, MOVE, STOP = range(5)
SUCCESS, FAIL, UNSUCCESSFUL, ABORTED = range(4)
_HEAD = struct.Struct("<HII")
HOMING_M_S = 0.1
STEP_S = 0.002
CLOSED_S = 0.1
"""How long a hand stays closed before it knows that it holds nothing."""


@dataclass
class GripperServer:
    """`between_m` is what the fingers meet; `stops_s` are the times (monotonic) at which a stop was taken."""

    host: str = field(default_factory=own_host)
    between_m: float | None = None
    deaf: bool = False
    ignores: bool = False
    reopens: bool = False  # after a grasp that found nothing
    slower: float = 1.0  # than commanded
    most_clients: int = 8
    lets_wait: bool = False  # clients beyond that many, instead of hanging up
    width_m: float = 0.06
    is_grasped: bool = False
    stops_s: list[float] = field(default_factory=list)
    begun_s: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._halt = threading.Event()
        self._moving = threading.Lock()
        self._clients: list[socket.socket] = []
        self._states: list[tuple[str, int]] = []
        self._listening = socket.create_server((self.host, PORT), backlog=8)
        threading.Thread(target=self._accept, daemon=True).start()
        threading.Thread(target=self._report, daemon=True).start()

    @property
    def moves(self) -> bool:
        return self._moving.locked()

    @property
    def connected(self) -> int:
        """How many programs there are."""
        return len(self._clients)

    def end(self) -> None:
        self._over.set()
        for one in (self._listening, *self._clients):
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        while not self._over.is_set():
            try:
                client, address = self._listening.accept()
            except OSError:
                return
            if len(self._clients) >= self.most_clients:
                if self.lets_wait:
                    self._clients.append(client)
                else:
                    client.close()
                continue
            self._clients.append(client)
            threading.Thread(target=self._serve, args=(client, address[0]), daemon=True).start()

    def _serve(self, client: socket.socket, address: str) -> None:
        states: list[tuple[str, int]] = []
        try:
            with suppress(OSError, struct.error):
                self._obey(client, address, states)
        finally:  # who has hung up makes room for another
            self._clients.remove(client)
            client.close()
            for one in states:
                self._states.remove(one)

    def _obey(self, client: socket.socket, address: str, states: list[tuple[str, int]]) -> None:
        while head := _exactly(client, _HEAD.size):
            command, number, size = _HEAD.unpack(head)
            content = _exactly(client, size - _HEAD.size)
            if command == CONNECT:
                _, port = struct.unpack_from("<HH", content)
                states.append((address, port))
                self._states.append(states[-1])
                _answer(client, command, number, struct.pack("<HH", SUCCESS, VERSION))
            elif command == STOP and self.ignores:
                self.stops_s.append(time.monotonic())
                _answer(client, command, number, struct.pack("<H", SUCCESS))
            elif command == STOP:
                self._halt.set()
                with self._moving:  # what moved has ended
                    self.stops_s.append(time.monotonic())
                    self.is_grasped = False
                    _answer(client, command, number, struct.pack("<H", SUCCESS))
            else:
                threading.Thread(target=self._do, args=(client, command, number, content), daemon=True).start()

    def _do(self, client: socket.socket, command: int, number: int, content: bytes) -> None:
        with self._moving:
            self._halt.clear()
            self.is_grasped = False
            self.begun_s.append(time.monotonic())
            status = self._status(command, content)
        if status == ABORTED and self.deaf:
            return
        with suppress(OSError):
            _answer(client, command, number, struct.pack("<H", status))

    def _status(self, command: int, content: bytes) -> int:
        if command == HOMING:
            for width_m in (0.0, WIDEST_M):
                if not self._go(width_m, HOMING_M_S):
                    return ABORTED
            return SUCCESS if self.between_m is None else UNSUCCESSFUL
        if command == MOVE:
            width_m, speed_m_s = struct.unpack_from("<dd", content)
            return SUCCESS if self._go(width_m, speed_m_s) else ABORTED
        width_m, inner_m, outer_m, speed_m_s, _force = struct.unpack_from("<ddddd", content)
        if not self._go(0.0, speed_m_s):
            return ABORTED
        self.is_grasped = self.between_m is not None and width_m - inner_m <= self.between_m <= width_m + outer_m
        if not self.is_grasped and self.reopens:
            self._halt.wait(CLOSED_S)
            self._go(WIDEST_M, speed_m_s)
        return SUCCESS if self.is_grasped else UNSUCCESSFUL

    def _go(self, width_m: float, speed_m_s: float) -> bool:
        """To a width, or to what is between the fingers; False where it was stopped."""
        goal_m = max(width_m, self.between_m or 0.0)
        step_m = STEP_S * speed_m_s / self.slower
        while abs(self.width_m - goal_m) > step_m:
            if self._halt.wait(STEP_S) or self._over.is_set():
                return False
            self.width_m += step_m if goal_m > self.width_m else -step_m
        self.width_m = goal_m
        return True

    def _report(self) -> None:
        number = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            line.bind((self.host, 0))
            while not self._over.wait(0.01):
                number += 1
                state = struct.pack("<Idd?H", number, self.width_m, WIDEST_M, self.is_grasped, 30)
                for client in list(self._states):
                    with suppress(OSError):
                        line.sendto(state, client)


def _exactly(client: socket.socket, size: int) -> bytes:
    content = b""
    while len(content) < size:
        if not (more := client.recv(size - len(content))):
            return b""
        content += more
    return content


def _answer(client: socket.socket, command: int, number: int, content: bytes) -> None:
    client.sendall(_HEAD.pack(command, number, _HEAD.size + len(content)) + content)


@contextmanager
def gripper(**options: object) -> Iterator[GripperServer]:
    server = GripperServer(**options)  # type: ignore[arg-type]
    try:
        yield server
    finally:
        server.end()
