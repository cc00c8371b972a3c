"""The program's end of the player process (`hw.franka.player`)."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from hw.franka.driver import LOST, UNAVAILABLE, Failure, Reading
from hw.franka.messages import Carry, Connect, Play, PlayOutcome, Read, Recover, Request, Timing
from hw.franka.playback import HOLD_S, PlayableMotion
from hw.franka.settings import FrankaSettings, Payload
from hw.types import Guard

WORD_EVERY_S = 0.005
"""How often the player is told, during a motion, to go on or to stop."""

ANSWER_S = 60.0
"""The longest wait for anything but a motion: the process starts, and libfranka takes its time where nobody answers."""

_END_S = 3.0
"""Longer than the longest stop along a path."""

_T = TypeVar("_T")


class PlayerProcess:
    """A running player. `pid` is its process; every method raises Failure when it is gone."""

    def __init__(self, model: str, settings: FrankaSettings, timing: Timing | None = None) -> None:
        """Start the process and connect to the arm. Raises Failure."""
        self._timing = timing = timing or Timing()
        ours, theirs = socket.socketpair()
        listen, self._say = os.pipe()
        os.set_blocking(self._say, False)
        # A session of its own: Ctrl-C on the terminal reaches the program, which brakes, and not the player.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "hw.franka.player", str(theirs.fileno()), str(listen), str(timing.silence_s)],
            pass_fds=(theirs.fileno(), listen),
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()
        os.close(listen)
        self._connection = Connection(ours.detach())
        self._asking = threading.Lock()
        try:
            self._ask(Connect(model, settings, timing))
        except Failure:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """The process number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """See `Player`."""
        return self._process.poll() is None

    def reading(self) -> Reading:
        """See `Player`."""
        return _known(self._ask(Read()), Reading)

    def recover(self) -> Reading:
        """See `Player`."""
        return _known(self._ask(Recover()), Reading)

    def carry(self, payload: Payload) -> Reading:
        """See `Player`."""
        return _known(self._ask(Carry(payload)), Reading)

    def play(self, motion: PlayableMotion, word: Callable[[], bytes], guard: Guard | None = None) -> PlayOutcome:
        """Play `motion`, with a guard until it touches.

        `word` is asked every 5 ms what to tell the player: ALIVE, PEDAL or REQUESTED.
        """
        longest_s = motion.path.duration_s + float(motion.stop_s.max()) + HOLD_S + self._timing.overrun_s
        with self._asking:
            self._send(Play(motion, guard))
            for _ in range(round(longest_s / WORD_EVERY_S)):
                if self._connection.poll(WORD_EVERY_S):
                    return _known(self._receive(), PlayOutcome)
                self._tell(word())
        self._kill()
        raise Failure(
            LOST, f"the player did not answer {self._timing.overrun_s:g} s after the motion should have ended"
        )

    def close(self) -> None:
        """End the process: the end of its pipes tells it to."""
        self._connection.close()
        os.close(self._say)
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._kill()

    def _ask(self, request: Request) -> Any:
        with self._asking:
            self._send(request)
            if not self._connection.poll(ANSWER_S):
                self._kill()
                raise Failure(LOST, f"the arm's player did not answer within {ANSWER_S:g} s")
            return self._receive()

    def _send(self, request: Request) -> None:
        try:
            self._connection.send(request)
        except OSError as error:
            raise self._gone() from error

    def _receive(self) -> Any:
        try:
            answer = self._connection.recv()
        except (EOFError, OSError) as error:
            raise self._gone() from error
        if isinstance(answer, Failure):
            raise answer
        return answer

    def _tell(self, word: bytes) -> None:
        with suppress(BlockingIOError, BrokenPipeError):  # full: it knows already; broken: the answer will say so
            os.write(self._say, word)

    def _gone(self) -> Failure:
        code = self._process.wait(_END_S)
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}"
        return Failure(LOST, f"the process that plays motions was {how}; the arm has stopped by itself")

    def _kill(self) -> None:
        self._process.kill()
        self._process.wait()


def _known(answer: Any, kind: type[_T]) -> _T:
    if not isinstance(answer, kind):
        raise Failure(UNAVAILABLE, f"the player answered {type(answer).__name__} where {kind.__name__} was due")
    return answer
