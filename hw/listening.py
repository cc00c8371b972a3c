"""What a device's own process hears of the program that started it: go on, stop, or nothing any more."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from collections.abc import Callable

ALIVE, PEDAL, REQUESTED = b".", b"P", b"S"
WHY = {PEDAL: "pedal", REQUESTED: "request"}
SILENT, ORPHANED = "silence", "orphaned"
SILENCE_S = 0.06
"""The longest silence of the program during a motion, as of the pedal."""
WORD_EVERY_S = 0.005
"""How often the program says, during a motion, to go on or to stop."""

_PR_SET_PDEATHSIG = 1


class Listener:
    """The pipe from the program, read once a cycle without waiting."""

    def __init__(self, pipe: int, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        os.set_blocking(pipe, False)
        self._pipe, self._silence_s, self._clock = pipe, silence_s, clock
        self.orphaned = False
        self._heard_s = clock()

    def begin(self) -> None:
        """Forget what was said before this motion: a program that still wants a stop says so again."""
        self.wanted()
        self._heard_s = self._clock()

    def wanted(self) -> str:
        """Why the motion shall stop, or an empty string."""
        try:
            said = os.read(self._pipe, 4096)
        except BlockingIOError:
            return SILENT if self._clock() - self._heard_s > self._silence_s else ""
        if not said:
            self.orphaned = True
            return ORPHANED
        self._heard_s = self._clock()
        return next((why for letter, why in WHY.items() if letter in said), "")


def die_with_parent(parent: int) -> None:
    """Have the system kill this process when the one that started it, `parent`, ends: also while it hangs in a driver.

    The parent starts it from its main thread: the system counts the end of that thread.
    """
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before
        os._exit(1)
