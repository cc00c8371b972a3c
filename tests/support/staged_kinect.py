"""A camera for `hw.camera.served` whose driver is a stand-in that shows captures by itself, in real time.

`ADAPTSIM_STAGED_KINECT` says what goes wrong: "hangs N" has the driver hang at its N-th capture, "hangs open" while it
is opened, "hangs stop" while it is stopped, "dies N" ends the process there, "dim N" exposes otherwise from there on.
"""

from __future__ import annotations

import os
import threading
import time
from typing import Any

from fake_k4a import PERIOD_S, FakeK4a, Shown, kinect_library

from hw.camera import k4a_types as k4a
from hw.camera.k4a import LiveCamera
from hw.camera.messages import Open


class LiveK4a(FakeK4a):
    """Captures come at 30 Hz of the real clock."""

    def __init__(self, *serials: str) -> None:
        super().__init__(*serials)
        how, _, when = os.environ.get("ADAPTSIM_STAGED_KINECT", "").partition(" ")
        self._how, self._when = how, when
        self._count, self._next_s = 0, time.monotonic()

    def _device_open(self, index: int, handle: Any) -> int:
        if self._when == "open":
            threading.Event().wait()
        return super()._device_open(index, handle)

    def _device_stop_cameras(self, handle: int) -> None:
        if self._when == "stop":
            threading.Event().wait()
        super()._device_stop_cameras(handle)

    def _device_get_capture(self, handle: int, capture: Any, timeout_ms: int) -> int:
        self._count += 1
        if self._how == "hangs" and str(self._count) == self._when:
            threading.Event().wait()
        if self._how == "dies" and str(self._count) == self._when:
            os._exit(7)
        if self._how == "dim" and str(self._count) == self._when:
            self.controls[k4a.EXPOSURE_TIME_ABSOLUTE] = (1, 2500)
        self._next_s += PERIOD_S
        time.sleep(max(self._next_s - time.monotonic(), 0.0))
        shown = Shown(time.monotonic() - 0.03, grey=100)
        capture[0] = self._hand_out(self._images(shown))
        return k4a.SUCCEEDED


def live(asked: Open) -> LiveCamera:
    """`hw.camera.served.Make`."""
    library = kinect_library(LiveK4a("A1"))
    return LiveCamera(asked.serial, asked.settings, infrared=asked.infrared, device=library.driver)
