"""How soon the player brakes when pedal or program fall silent, at their real 60 ms, and what a sleep does to both.

    PYTHONPATH=tests/support python benchmarks/silence.py --times 10

The program, its player, the pedal's serial line (a pseudo-terminal) and the FR3's protocol are real; the arm is
franky-sim's, which waits for late commands. Meanwhile, a process that sends itself a byte over such a line every
millisecond measures how long this computer delays a process or a line. Results during delays of more than `NOISE_S` do
not count.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fr3_process import Fr3Process, fr3
from serial_lines import Box, boxed, plugged_in

PROGRAM = Path(__file__).parents[1] / "tests" / "support" / "moving_program.py"
NOISE_S = 0.01
UNHURRIED = ("setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice") if os.geteuid() == 0 else ()
"""The program's player may not ask for real-time priority (capabilities(7)): of two cores the SDK's thread would take
one, at priority 99, and the start of a motion hold up the arm, the pedal and the measuring process for 0.1 s."""
AT_S = (0.8, 1.6)
"""When the fault comes: in the middle of a motion of 3 s."""
ASLEEP_S = 2.0


class Noise:
    """The longest time by which a process was woken, or its byte came, too late, since `forget`."""

    def __enter__(self) -> Noise:
        self._worst = multiprocessing.Value("d", 0.0)
        self._sleeper = multiprocessing.Process(target=_sleep, args=(self._worst,), daemon=True)
        self._sleeper.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._sleeper.kill()
        self._sleeper.join()

    def forget(self) -> None:
        self._worst.value = 0.0

    @property
    def worst_s(self) -> float:
        return float(self._worst.value)


def _sleep(worst: Any) -> None:
    mine, its = os.openpty()
    tty.setraw(its)
    before_s = time.monotonic()
    while True:
        time.sleep(1e-3)
        os.write(mine, b".")
        os.read(its, 1)
        now_s = time.monotonic()
        worst.value = max(worst.value, now_s - before_s - 1e-3)
        before_s = now_s


@dataclass(frozen=True)
class Happened:
    """The effect of one fault: times of `time.monotonic`, and how long this computer delayed a process meanwhile."""

    at_s: float  # the last sign of life
    said: dict[str, Any]  # by the program, after its motion
    noise_s: float
    commands: int  # that reached the arm from the fault on

    @property
    def braking_after_s(self) -> float:
        return float(self.said["braked_s"]) - self.at_s

    @property
    def still_after_s(self) -> float:
        return float(self.said["still_s"]) - self.at_s


@dataclass
class Moving:
    """A program in the middle of its motion, and its pedal's box."""

    server: Fr3Process
    box: Box
    program: subprocess.Popen[str]
    player: int

    def signal(self, number: signal.Signals, *, player: bool) -> None:
        os.kill(self.program.pid, number)
        if player:
            os.kill(self.player, number)


Fault = Callable[[Moving], float]
"""Brings a fault about and ends it -> the last sign of life (`time.monotonic`)."""


def silent_pedal(moving: Moving) -> float:
    """The box falls silent."""
    moving.box.silent = True
    return moving.box.last_s


def hanging_program(moving: Moving) -> float:
    """The program falls silent; its player continues."""
    moving.signal(signal.SIGSTOP, player=False)
    stopped_s = time.monotonic()
    time.sleep(1.0)
    moving.signal(signal.SIGCONT, player=False)
    return stopped_s


def suspended(moving: Moving) -> float:
    """The whole computer sleeps, the arm does not, and the pedal is held all the time."""
    moving.signal(signal.SIGSTOP, player=True)
    stopped_s = time.monotonic()
    time.sleep(ASLEEP_S)
    moving.signal(signal.SIGCONT, player=True)
    return stopped_s


FAULTS: dict[str, Fault] = {"pedal": silent_pedal, "program": hanging_program, "sleep": suspended}


@contextmanager
def programmed(server: Fr3Process) -> Iterator[Moving]:
    """A program that has connected; it moves once the pedal's box says that it is pressed."""
    with plugged_in() as line, boxed(line) as box:
        program = subprocess.Popen(
            [*UNHURRIED, sys.executable, str(PROGRAM), server.host, line.port],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert program.stdout is not None
            yield Moving(server, box, program, json.loads(program.stdout.readline())["player"])
        finally:
            program.send_signal(signal.SIGCONT)
            program.kill()
            program.communicate()


@dataclass(frozen=True)
class EndedEarly:
    """A motion that ended before its fault: the output of the program, and how long a process or the pedal's thread was
    delayed.
    """

    said: dict[str, Any]
    noise_s: float


def happened(noise: Noise, fault: Fault, at_s: float) -> Happened | EndedEarly:
    """One motion, and one fault at this time of the motion."""
    last_s, commands, before_s = list[float](), list[int](), list[float]()
    with fr3() as server, programmed(server) as moving:

        def bring_about() -> None:
            before_s.append(noise.worst_s)
            noise.forget()
            commands.append(len(server.commanded()))
            with suppress(ProcessLookupError):  # the motion ended before
                last_s.append(fault(moving))

        mark = server.at(at_s, lambda: threading.Thread(target=bring_about).start())
        noise.forget()
        moving.box.pressed, moving.box.late_s = True, 0.0
        assert moving.program.stdout is not None
        report = json.loads(moving.program.stdout.readline())
        worst_s = noise.worst_s
        if not last_s:
            return EndedEarly(report, max(worst_s, *before_s, moving.box.late_s))
        mark.join()
        return Happened(last_s[0], report, worst_s, len(server.commanded()) - commands[0])


def quietest(noise: Noise, fault: Fault, at_s: float, tries: int = 5) -> Happened | EndedEarly:
    """The first of some tries without delays of more than `NOISE_S` by this computer, else the one with the smallest
    delay.
    """
    attempts = list[Happened | EndedEarly]()
    while len(attempts) < tries and not (attempts and attempts[-1].noise_s <= NOISE_S):
        attempts.append(happened(noise, fault, at_s))
    return min(attempts, key=lambda one: one.noise_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=10, help="of each fault")
    times = parser.parse_args().times
    with Noise() as noise:
        for name, fault in FAULTS.items():
            seen = [quietest(noise, fault, at_s) for at_s in np.linspace(*AT_S, times)]
            counted = [one for one in seen if isinstance(one, Happened) and one.noise_s <= NOISE_S]
            sys.stdout.write(f"{name}: {len(counted)} of {times} in quiet, load {os.getloadavg()[0]:.1f}\n")
            if not counted:
                continue
            late_ms = 1e3 * max(one.noise_s for one in counted)
            refused = sum(bool(one.said["error"]) and not one.said["enabled"] for one in counted)
            sys.stdout.write(
                f"  this computer was at most {late_ms:.1f} ms late; stopped, and to be pressed again: {refused}\n"
            )
            for what, ms in (
                ("braking", [1e3 * one.braking_after_s for one in counted]),
                ("standstill", [1e3 * one.still_after_s for one in counted]),
            ):
                sys.stdout.write(
                    f"  {what} after the last sign of life: median {np.median(ms):.0f}, longest {max(ms):.0f} ms\n"
                )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
