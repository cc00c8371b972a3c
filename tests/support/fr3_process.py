"""Starting, steering and ending `fr3_server.py`, each at a loopback address of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Self

import numpy as np
from cells import READY, cell
from numpy.typing import ArrayLike

from hw.collision import BARE_HAND, Tool
from hw.franka.arm import FrankaArm, Pedal, franka
from hw.franka.playback import Timing
from hw.franka.settings import FrankaSettings
from hw.types import Array

SERVER = Path(__file__).with_name("fr3_server.py")
_HOSTS = count()
RELAXED = Timing(realtime=False, silence_s=2.0, start_s=20.0, unwatched_s=20.0, overrun_s=60.0)
READY_RAD = READY


class Fr3Process:
    """A running server. `pid` may be stopped, continued or killed."""

    def __init__(self, host: str, q_rad: ArrayLike, *, interface: int = 10, pace: str = "patient") -> None:
        self.host = host
        self._process = subprocess.Popen(
            [
                sys.executable,
                str(SERVER),
                host,
                str(interface),
                pace,
                *(f"{v:.12f}" for v in np.asarray(q_rad)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._expect("ready")

    @property
    def pid(self) -> int:
        return self._process.pid

    def tell(self, line: str) -> str:
        """Say `line`, wait until it was obeyed; what was answered before."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._expect("done")

    def place(self, q_rad: ArrayLike) -> None:
        """Put the arm there, at rest, all faults forgotten."""
        self.tell("place " + " ".join(f"{v:.12f}" for v in np.asarray(q_rad)))

    def received(self) -> list[list[float] | None]:
        """The commanded joints of the last motion, cycle by cycle, None where none came."""
        rows: list[list[float] | None] = json.loads(self.tell("report"))["received"]
        return rows

    def moves(self) -> bool:
        """Whether a motion goes on."""
        return bool(json.loads(self.tell("report"))["moves"])

    def configured(self) -> list[str]:
        """The setters that the arm has taken, in their order."""
        names: list[str] = json.loads(self.tell("report"))["configured"]
        return names

    def commanded(self) -> Array:
        """(M, 7): the commanded joints of the last motion."""
        return np.array([q for q in self.received() if q is not None])

    def at(self, seconds: float, do: Callable[[], object], after: int = 0) -> threading.Thread:
        """A thread that does something so long into the next motion but `after`, as the arm counts its time."""
        self.tell(f"mark {seconds} {after}")

        def wait() -> None:
            assert self._process.stderr is not None
            for line in self._process.stderr:
                if line == "mark\n":
                    do()
                    return

        thread = threading.Thread(target=wait, daemon=True)
        thread.start()
        return thread

    def signal(self, number: signal.Signals) -> None:
        os.kill(self.pid, number)

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()

    def _expect(self, word: str) -> str:
        assert self._process.stdout is not None
        before = ""
        for line in self._process.stdout:
            if line.strip() == word:
                return before
            before += line
        raise AssertionError(f"the simulated FR3 ended before it said {word!r}: {before}")


class HandPedal:
    """A pedal that a test holds and lets go of."""

    def __init__(self, *, held: bool = True) -> None:
        self.held, self.released_s = held, 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...

    def release(self) -> None:
        self.released_s = time.monotonic()
        self.held = False

    def enabled(self) -> bool:
        return self.held

    def why_not(self) -> str:
        return "the pedal is released"


def own_host() -> str:
    """A loopback address that no other test uses, in this process or beside it."""
    return f"127.{os.getpid() >> 8 & 255}.{os.getpid() & 255}.{next(_HOSTS) % 250 + 2}"


@contextmanager
def fr3(q_rad: ArrayLike = READY_RAD, **options: int | str) -> Iterator[Fr3Process]:
    server = Fr3Process(own_host(), q_rad, **options)  # type: ignore[arg-type]
    try:
        yield server
    finally:
        server.end()


def arm_at(
    server: Fr3Process, *, tool: Tool = BARE_HAND, pedal: Pedal | None = None, timing: Timing = RELAXED
) -> FrankaArm:
    return franka(cell("fr3", tool), FrankaSettings(server.host), timing, pedal=pedal)
