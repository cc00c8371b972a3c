"""The enabling pedal on its serial port."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Self

import serial

from hw.errors import DeviceUnavailable
from hw.serial.pedal_protocol import SILENCE_S, PedalState
from hw.watchdog import since_boot_s

BAUD = 115_200
_GREETING_S = 3.0
"""The longest wait for the first line: an Arduino restarts when its port is opened, which takes 1.2 s or more."""


class EnablePedal:
    """A pedal that is held to run. A thread listens, so `enabled` is always fresh; it is False if there is any doubt.

    Not a safety device: the stop button of the arm is.
    """

    def __init__(self, port: str, clock: Callable[[], float] = since_boot_s) -> None:
        self._port, self._clock = port, clock
        self._line: serial.Serial | None = None
        self._listener: threading.Thread | None = None
        self._closing = threading.Event()
        self._heard = threading.Event()
        self._state = PedalState()  # only the listener replaces it, and always as a whole
        self._lost = ""

    def __enter__(self) -> Self:
        """Open the port and wait for the first line. Raises DeviceUnavailable."""
        try:
            self._line = serial.Serial(self._port, BAUD, timeout=SILENCE_S / 4, exclusive=True)
        except (OSError, serial.SerialException) as error:
            raise DeviceUnavailable(
                f"enabling pedal: {self._port} cannot be opened ({error}); check cable, name and permission "
                "(on Debian: the group dialout)"
            ) from error
        self._line.reset_input_buffer()
        self._listener = threading.Thread(target=self._listen, name="enable-pedal", daemon=True)
        self._listener.start()
        self._heard.wait(_GREETING_S)
        if self._state.last is None:
            reason = self._state.why_not(self._clock())
            self.__exit__()
            raise DeviceUnavailable(f"enabling pedal at {self._port}: {reason}")
        return self

    def __exit__(self, *exc: object) -> None:
        self._closing.set()
        if self._listener is not None:
            self._listener.join()
        if self._line is not None:
            self._line.close()

    def enabled(self) -> bool:
        """Whether motion is allowed at this moment."""
        return not self._lost and not self._closing.is_set() and self._state.enabled(self._clock())

    def why_not(self) -> str:
        """The reason for the operator why motion is not allowed."""
        if self._closing.is_set():
            return "the pedal is no longer connected"
        return self._lost or self._state.why_not(self._clock())

    def _listen(self) -> None:
        assert self._line is not None
        while not self._closing.is_set():
            try:
                data = self._line.read(1)
                data += self._line.read(self._line.in_waiting) if data else b""
            except (OSError, TypeError, serial.SerialException) as error:  # unplugged during a read
                self._lost = f"the pedal was unplugged ({error}): plug it in and connect again"
                self._heard.set()
                return
            self._state = self._state.feed(data, self._clock())
            if self._state.last is not None or self._state.other_version:
                self._heard.set()
