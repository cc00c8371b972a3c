"""How a device's process listens to the program that started it: continue, stop, or silence."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from collections.abc import Callable

ALIVE, PEDAL, REQUESTED = b".", b"P", b"S"
WHY = {PEDAL: "pedal", REQUESTED: "request"}
SILENT, ORPHANED = "silence", "orphaned"
IN_WORDS = {
    "pedal": "the enabling pedal was released",
    "request": "a stop was requested",
    SILENT: "the program was silent for too long",
    ORPHANED: "the program ended",
}
"""Why a motion was stopped, for the operator."""
SILENCE_S = 0.06
"""The longest silence of the program during a motion; the same as for the pedal."""
WORD_EVERY_S = 0.005
"""How often the program writes a word (continue or stop) during a motion."""

_PR_SET_PDEATHSIG = 1


def since_boot_s() -> float:
    """Seconds since the computer started, its sleep included (`time.monotonic` leaves that out on Linux).

    With this clock, no word from before a sleep looks new afterwards.
    """
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Watchdog:
    """The pipe from the program, read once per cycle without waiting."""

    def __init__(self, pipe: int, silence_s: float, clock: Callable[[], float] = since_boot_s) -> None:
        os.set_blocking(pipe, False)
        self._pipe, self._silence_s, self._clock = pipe, silence_s, clock
        self.orphaned = False
        self._heard_s = clock()

    def begin(self) -> None:
        """Forget words from before this motion. A program that still wants a stop repeats it."""
        self.stop_reason()
        self._heard_s = self._clock()

    def stop_reason(self) -> str:
        """The reason to stop the motion, or ""."""
        try:
            letters = os.read(self._pipe, 4096)
        except BlockingIOError:
            return SILENT if self._clock() - self._heard_s > self._silence_s else ""
        if not letters:
            self.orphaned = True
            return ORPHANED
        self._heard_s = self._clock()
        return next((why for letter, why in WHY.items() if letter in letters), "")


def die_with_parent(parent: int) -> None:
    """Have the system kill this process when its `parent` ends, even while a driver blocks it.

    The parent must start it from its main thread, because the system watches the end of that thread.
    """
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent ended before
        os._exit(1)
