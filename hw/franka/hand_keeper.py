"""The process that watches over the hand: `python -m hw.franka.hand_keeper`, started by the program.

A worker moves the fingers, because an SDK may block its process until they stand still. Meanwhile the keeper listens to
the program. It stops the hand through a second worker with a connection of its own (`Gripper.stop`) if the program asks
for it, is silent for 60 ms, or has ended. A worker that goes on nevertheless is killed with its connection.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol

from hw.child import Child, ChildGone
from hw.errors import DeviceUnavailable
from hw.franka.hand_messages import Answer, Done, NotDone, Open, Request, State, Stop, Stopped
from hw.watchdog import WORD_EVERY_S, Watchdog

WORKER_S = 0.5
"""How long a stopped worker may take for its last answer."""
OPEN_S = 30.0
"""The longest wait for a connection: libfranka is slow to give up on an address that does not answer."""
SECOND_S = 10.0
"""The longest wait for the second connection, once the hand has accepted the first."""
READ_S = 3.0
"""The longest wait for a state."""
STOP_S = 1.0
"""The longest wait for the answer to a stop."""


class Worker(Protocol):
    """The worker's process as the keeper uses it (`hw.child.Child`)."""

    def send(self, request: object) -> None:
        """See `hw.child.Child`."""
        ...

    def answers(self, within_s: float) -> bool:
        """See `hw.child.Child`."""
        ...

    def receive(self) -> Any:
        """See `hw.child.Child`."""
        ...

    def kill(self) -> None:
        """See `hw.child.Child`."""
        ...


class Keeper:
    """One hand: its worker, and the connection that stops it."""

    def __init__(self, opened: Open, listener: Watchdog, worker: Worker, stop: Callable[[], object]) -> None:
        self._opened, self._listener, self._worker, self._stop = opened, listener, worker, stop
        self._ended = False

    def ask(self, request: Request) -> Answer:
        """Have the worker do it, and stop it if the program wants that. A worker that ended is not restarted."""
        if self._ended:
            return NotDone("the hand was stopped in the middle of a command: connect again, and home it", lost=True)
        try:
            self._worker.send(request)
            return self._wait(READ_S) if isinstance(request, State) else self._watch()
        except ChildGone as how:
            self._ended = True
            with suppress(Exception):  # the fingers must stop, whatever the SDK raises
                self._stop()
            return NotDone(f"the process that moves the hand was {how}; a stop was sent to the hand", lost=True)

    def _wait(self, within_s: float) -> Answer:
        if self._worker.answers(within_s):
            return _known(self._worker.receive())
        self._end()
        return NotDone(f"the hand at {self._opened.host} does not answer within {within_s:g} s", lost=True)

    def _watch(self) -> Answer:
        self._listener.begin()
        while not self._worker.answers(WORD_EVERY_S):
            if why := self._listener.wanted():
                return self._halt(why)
        return _known(self._worker.receive())

    def _halt(self, why: str) -> Answer:
        began_s = time.monotonic()
        try:
            self._stop()
        except Exception as error:  # noqa: BLE001 each SDK has its own errors, and the worker must end in any case
            self._end()
            return NotDone(f"the hand could not be stopped ({error}); its connection was closed", lost=True)
        after_s = time.monotonic() - began_s
        if self._worker.answers(WORKER_S):
            with suppress(ChildGone):
                self._worker.receive()
                return Stopped(why, after_s)
        self._end()
        return Stopped(why, after_s)

    def _end(self) -> None:
        self._ended = True
        self._worker.kill()


def serve(program: Connection, listener: Watchdog) -> None:
    """Answer requests until the program is gone. If it goes during a command, the hand is stopped."""
    keeper: Keeper | None = None
    while not listener.orphaned:
        try:
            request: Request = program.recv()
        except (EOFError, OSError):
            return
        if isinstance(request, Open):
            keeper, answer = opened(request, listener)
        elif keeper is None:
            answer = NotDone("the hand is not connected", lost=True)
        else:
            answer = keeper.ask(request)
        with suppress(OSError):  # the program is gone
            program.send(answer)


def opened(request: Open, listener: Watchdog) -> tuple[Keeper | None, Answer]:
    """Open the worker's connection to the hand, and a second one through which to stop it."""
    worker, answer = _connected(request, OPEN_S)
    if worker is None:
        return None, answer
    stopper, second = _connected(request, SECOND_S)
    if stopper is None:
        worker.kill()
        why = second.text if isinstance(second, NotDone) else "it gave no state"
        return None, NotDone(
            f"the hand at {request.host} does not accept a second connection ({why}), and without one nothing could "
            'stop it: end other programs that use it, or put waived = ["hand"] into the rig file and close the hand '
            "in Desk",
            lost=True,
        )
    return Keeper(request, listener, worker, lambda: _stopped(stopper)), answer


def _connected(request: Open, within_s: float) -> tuple[Child | None, Answer]:
    """A worker with a connection of its own, and the hand's state; no worker if there is no connection."""
    worker = Child("hw.franka.hand_worker", str(os.getpid()))
    try:
        worker.send(request)
        if worker.answers(within_s):
            answer = _known(worker.receive())
        else:
            worker.kill()
            answer = NotDone(f"the hand at {request.host} does not answer within {within_s:g} s", lost=True)
    except ChildGone as how:
        answer = NotDone(f"the process that moves the hand was {how}", lost=True)
    return (worker if isinstance(answer, Done) else None), answer


def _stopped(stopper: Worker) -> None:
    """Raises DeviceUnavailable or ChildGone if the hand did not accept the stop."""
    stopper.send(Stop())
    answer = _known(stopper.receive()) if stopper.answers(STOP_S) else NotDone(f"no answer within {STOP_S:g} s")
    if isinstance(answer, NotDone):
        raise DeviceUnavailable(answer.text)


def _known(answer: Any) -> Answer:
    if isinstance(answer, Done | NotDone | Stopped):
        return answer
    return NotDone(f"the hand's worker answered {type(answer).__name__}", lost=True)


def main(connection_fd: str, pipe_fd: str, silence_s: str) -> None:
    """Serve one program until it hangs up; the arguments are file descriptors and a time in seconds."""
    with Connection(int(connection_fd)) as program:
        serve(program, Watchdog(int(pipe_fd), float(silence_s)))


if __name__ == "__main__":
    main(*sys.argv[1:])
