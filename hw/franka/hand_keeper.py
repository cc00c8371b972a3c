"""The process that watches over the hand: `python -m hw.franka.hand_keeper`, started by the program.

A worker moves the fingers, because an SDK may block its process until they stand still. Meanwhile the keeper listens to
the program. It stops the hand through a second worker with a connection of its own (`Gripper.stop`) if the program asks
for it, is silent for 60 ms, or has ended. A worker that goes on nevertheless is killed with its connection.

A third worker, if the hand takes a third connection, reads the width while the fingers move: a stop may be accepted and
ignored (`hw.franka.hand_stop`), and after a grasp that failed they may have opened again. If there is no third
connection, the second one reads the width after a stop.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection

from hw.child import Call, Child, ChildGone
from hw.errors import DeviceUnavailable, HandError
from hw.franka.hand import OPEN, STATE, WIDTHS, Answer, NothingGrasped
from hw.franka.hand_stop import Reader, Widths, stopped
from hw.types import HandState
from hw.watchdog import WORD_EVERY_S, Watchdog

WORKER_S = 0.5
"""How long a stopped worker may take for its last answer."""
OPEN_S = 30.0
"""The longest wait for a connection: libfranka is slow to give up on an address that does not answer."""
SECOND_S = 10.0
"""The longest wait for the second connection, once the hand has accepted the first."""
THIRD_S = 3.0
"""The same for the third."""
EMPTY_M = 0.001
"""Fingers this close have met nothing."""
READ_S = 3.0
"""The longest wait for a state."""
STOP_S = 1.0
"""The longest wait for the answer to a stop."""


class HandWatcher:
    """`hw.franka.hand_stop.Reader`: a worker that reads widths with a connection of its own, meanwhile."""

    def __init__(self, worker: Child) -> None:
        """Begins to read."""
        self._worker: Child | None = worker
        self._ask(WIDTHS)

    def read(self, for_s: float) -> Widths:
        """See `Reader`."""
        if self._worker is None:
            return ()
        self._worker.answers(for_s)  # it answers before it is asked only if it has ended, or lost the hand
        self._ask(WIDTHS)
        return self._rows()

    def end(self) -> Widths:
        """The widths since the last call; then it reads no more."""
        self._ask(STATE)  # whatever call comes next ends it
        rows = self._rows()
        return rows if isinstance(self._answer(), HandState) else ()

    def _ask(self, method: str) -> None:
        try:
            if self._worker is not None:
                self._worker.send(Call(method))
        except ChildGone:
            self._worker = None

    def _rows(self) -> Widths:
        answer = self._answer()
        return answer if isinstance(answer, Sequence) else ()

    def _answer(self) -> Answer | None:
        try:
            if self._worker is not None:
                if self._worker.answers(READ_S):
                    return _answer(self._worker)
                self._worker.kill()  # a late answer would be taken for that to a later question
        except ChildGone:
            pass
        self._worker = None
        return None


class Poller:
    """`hw.franka.hand_stop.Reader`: asks a worker for the width again and again."""

    def __init__(self, worker: Child) -> None:
        self._worker = worker

    def read(self, for_s: float) -> Widths:
        """See `Reader`; earlier widths are not known."""
        rows, until_s = list[tuple[float, float]](), time.monotonic() + for_s
        with suppress(ChildGone):
            while not rows or rows[-1][0] < until_s:
                self._worker.send(Call(STATE))
                answer = _answer(self._worker) if self._worker.answers(READ_S) else None
                if not isinstance(answer, HandState):
                    return ()
                rows.append((time.monotonic(), answer.width_m))
        return rows


class Keeper:
    """One hand: its worker, and the connection that stops it."""

    def __init__(
        self,
        host: str,
        listener: Watchdog,
        worker: Child,
        stop: Callable[[], object],
        watch: Callable[[], Reader | None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`watch` begins to read the width of a hand that begins to move."""
        self._host, self._listener, self._worker, self._stop = host, listener, worker, stop
        self._watch, self._clock = watch, clock
        self._ended = False

    def ask(self, call: Call) -> Answer:
        """Pass the request to the worker, and stop the fingers if the program asks for that. An ended worker is not
        restarted.
        """
        if self._ended:
            return DeviceUnavailable("the hand was stopped in the middle of a command: connect again, and home it")
        try:
            if call.method == STATE:
                self._worker.send(call)
                return self._wait(READ_S)
            return self._move(call)
        except ChildGone as how:
            self._ended = True
            with suppress(Exception):  # the fingers must stop, whatever the SDK raises
                self._stop()
            return DeviceUnavailable(f"the process that moves the hand was {how}; a stop was sent to the hand")

    def _move(self, call: Call) -> Answer:
        """If a grasp finds nothing, the error names the width to which the fingers had closed."""
        reader = self._watch()
        try:
            self._worker.send(call)
            self._listener.begin()
            while not self._worker.answers(WORD_EVERY_S):
                if why := self._listener.stop_reason():
                    return self._halt(why, reader)
            answer = _answer(self._worker)
        finally:
            widths = reader.end() if isinstance(reader, HandWatcher) else ()
        return HandError(f"{answer}; {_closed(widths)}") if isinstance(answer, NothingGrasped) else answer

    def _wait(self, within_s: float) -> Answer:
        if self._worker.answers(within_s):
            return _answer(self._worker)
        self._end()
        return DeviceUnavailable(f"the hand at {self._host} does not answer within {within_s:g} s")

    def _halt(self, why: str, reader: Reader | None) -> Answer:
        def last_answer() -> None:
            if self._worker.answers(WORKER_S):
                with suppress(ChildGone):
                    self._worker.receive()
                    return
            self._end()

        try:
            return stopped(why, self._stop, reader, self._clock, last_answer)
        except Exception as error:  # noqa: BLE001 each SDK has its own errors, and the worker must end in any case
            self._end()
            return DeviceUnavailable(
                f"the hand could not be stopped ({error}); its connection was closed, and the fingers may still move. "
                "Keep clear of them, switch the arm off at its control box if they hold what they must not, and look "
                "at the hand before you run the command again"
            )

    def _end(self) -> None:
        self._ended = True
        self._worker.kill()


def serve(program: Connection, listener: Watchdog) -> None:
    """Answer requests until the program is gone. If it goes during a command, the hand is stopped."""
    keeper: Keeper | None = None
    while not listener.orphaned:
        try:
            call: Call = program.recv()
        except (EOFError, OSError):
            return
        if call.method == OPEN:
            keeper, answer = opened(call, listener)
        elif keeper is None:
            answer = DeviceUnavailable("the hand is not connected")
        else:
            answer = keeper.ask(call)
        with suppress(OSError):  # the program is gone
            program.send(answer)


def opened(call: Call, listener: Watchdog) -> tuple[Keeper | None, Answer]:
    """Open the worker's connection to the hand, and a second one through which to stop it."""
    worker, answer = _connected(call, OPEN_S)
    if worker is None:
        return None, answer
    stopper, second = _connected(call, SECOND_S)
    if stopper is None:
        worker.kill()
        return None, DeviceUnavailable(
            f"the hand at {call.arguments[1]} does not accept a second connection ({second}), and without one nothing "
            "could stop it: end other programs that use it, or screw the tool on (docs/guide/rig.md#waivers)"
        )
    watcher, _ = _connected(call, THIRD_S)
    watch: Callable[[], Reader] = partial(Poller, stopper) if watcher is None else partial(HandWatcher, watcher)
    return Keeper(call.arguments[1], listener, worker, lambda: _stopped(stopper), watch), answer


def _connected(call: Call, within_s: float) -> tuple[Child | None, Answer]:
    """A worker with a connection of its own, and the hand's state; no worker if there is no connection."""
    worker = Child("hw.franka.hand", str(os.getpid()))
    try:
        worker.send(call)
        if worker.answers(within_s):
            answer = _answer(worker)
        else:
            worker.kill()
            answer = DeviceUnavailable(f"the hand at {call.arguments[1]} does not answer within {within_s:g} s")
    except ChildGone as how:
        answer = DeviceUnavailable(f"the process that moves the hand was {how}")
    return (worker if isinstance(answer, HandState) else None), answer


def _closed(widths: Widths) -> str:
    """The width at which a failed grasp ended, for a person."""
    if not widths:
        return "if it was there, measure its width and correct it"
    narrowest_mm = 1e3 * min(width_m for _, width_m in widths)
    if narrowest_mm <= 1e3 * EMPTY_M:
        return f"they closed to {narrowest_mm:.1f} mm, on nothing"
    width = f"{narrowest_mm:.1f} mm"
    return f"they closed to {width}: if that was the handle, correct its width to {width}"


def _stopped(stopper: Child) -> None:
    """Raises DeviceUnavailable or ChildGone if the hand did not accept the stop."""
    stopper.send(Call("stop"))
    answer = _answer(stopper) if stopper.answers(STOP_S) else f"no answer within {STOP_S:g} s"
    if not isinstance(answer, HandState):
        raise DeviceUnavailable(str(answer))


def _answer(worker: Child) -> Answer:
    """The next answer of a worker. Raises ChildGone."""
    answer: Answer = worker.receive()
    return answer


def main(connection_fd: str, pipe_fd: str, silence_s: str) -> None:
    """Serve one program until it hangs up; the arguments are file descriptors and a time in seconds."""
    with Connection(int(connection_fd)) as program:
        serve(program, Watchdog(int(pipe_fd), float(silence_s)))


if __name__ == "__main__":
    main(*sys.argv[1:])
