"""Serial lines without devices: a pseudo-terminal, the pedal's box and a balance at its other end."""

from __future__ import annotations

import os
import pty
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from hw.serial.pedal_protocol import PERIOD_S, line_for

PATIENCE_S = 60.0


class Line:
    """A serial line; the test holds the device's end."""

    def __init__(self) -> None:
        self.device, self.program = pty.openpty()
        tty.setraw(self.device)
        tty.setraw(self.program)
        self.port = os.ttyname(self.program)

    def unplug(self) -> None:
        ends, self.device, self.program = (self.device, self.program), -1, -1
        for end in ends:
            if end >= 0:
                os.close(end)


@contextmanager
def plugged_in() -> Iterator[Line]:
    line = Line()
    try:
        yield line
    finally:
        line.unplug()


class Box(threading.Thread):
    """The pedal's box: a line every 20 ms."""

    def __init__(self, line: Line) -> None:
        super().__init__(daemon=True)
        self.line, self._ended = line, threading.Event()
        self.lifted = 0  # lines from now at which the foot presses again; 0: it does what it does
        self.pressed, self.silent = False, False
        self.last_s = 0.0  # time.monotonic of the last line
        self.late_s = 0.0  # by which a line came too late at most: this thread was held up

    def run(self) -> None:
        counter = 0
        while not self._ended.wait(PERIOD_S):
            self.lifted = max(0, self.lifted - 1)
            self.pressed = self.pressed or self.lifted == 1
            if not self.silent:
                with suppress(OSError):  # pulled out between two looks, or nobody reads
                    os.write(self.line.device, line_for(counter, self.pressed))
                    before_s, self.last_s = self.last_s, time.monotonic()
                    self.late_s = max(self.late_s, self.last_s - before_s - PERIOD_S)
            counter += 1

    def stop(self) -> None:
        self._ended.set()
        self.join()


@contextmanager
def boxed(line: Line) -> Iterator[Box]:
    box = Box(line)
    box.start()
    try:
        yield box
    finally:
        box.stop()


@contextmanager
def answering(line: Line, answers: Sequence[bytes]) -> Iterator[list[bytes]]:
    """A balance that gives these answers in turn, one to each question. Yields the questions that it was asked."""
    asked: list[bytes] = []

    def answer() -> None:
        for text in answers:
            asked.append(os.read(line.device, 16))
            os.write(line.device, text)

    device = threading.Thread(target=answer, daemon=True)
    device.start()
    yield asked
    device.join(PATIENCE_S)
    assert not device.is_alive(), f"{len(asked)} of {len(answers)} questions were asked"


def until(condition: Callable[[], bool]) -> None:
    """Return when it holds. Fails when it does not come to hold: the other end is a thread of its own."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < PATIENCE_S, "it never came to hold"
        threading.Event().wait(0.0005)
