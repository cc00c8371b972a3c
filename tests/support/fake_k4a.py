"""A libk4a made of C callbacks with the prototypes of the real one: what the adapter passes goes through ctypes.

Captures are shown one by one by the test; nothing waits for real time. It counts what it has handed out, so that a
capture or an image that is never released is found.

`live` is a camera of `hw.camera.served` on it that shows captures by itself, in real time. `ADAPTSIM_STAGED_KINECT`
says what goes wrong there: "hangs N" has the driver hang at its N-th capture, "hangs open" while it is opened,
"hangs stop" while it is stopped, "dies N" ends the process there, "dim N" exposes otherwise from there on.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from camera_stage import DELAY_S, Shown, Stage, enter

from hw.camera import k4a_library as k4a
from hw.camera.k4a_device import K4aDevice
from hw.camera.k4a_library import PROTOTYPES
from hw.camera.process import CameraProcess
from hw.camera.served import Device, LiveCamera, Make, serve

BOOT_S = 40.0  # host time at which the device's clock began
PERIOD_S = 1.0 / 30.0
PADDING = 4  # pixels that follow each row of depth and infrared
IMAGES = {f"capture_get_{kind}_image": name for kind, name in
          (("color", "colour"), ("depth", "depth"), ("ir", "infrared"))}  # fmt: skip
FACTS = {
    f"image_get_{fact}": fact.removesuffix("_pixels").removesuffix("_bytes").replace("timestamp_", "")
    for fact in ("size", "format", "width_pixels", "height_pixels", "stride_bytes", "device_timestamp_usec",
                 "system_timestamp_nsec", "exposure_usec")
}  # fmt: skip
"""Functions of the library that read one field of an image."""


@dataclass(frozen=True)
class _Image:
    format: int
    content: Any
    size: int
    width: int
    height: int
    stride: int
    device_usec: int
    system_nsec: int
    exposure_usec: int


class FakeK4a(Stage):
    """`serials`: the cameras that are plugged in; `busy`: those that cannot be opened."""

    def __init__(self, *serials: str, busy: tuple[str, ...] = ()) -> None:
        super().__init__()
        self.serials, self.busy = serials, busy
        self.calibration = k4a.K4aCalibration()
        for camera in (self.calibration.color_camera_calibration, self.calibration.depth_camera_calibration):
            camera.intrinsics.type = k4a.BROWN_CONRADY
        self.controls = {k4a.EXPOSURE_TIME_ABSOLUTE: (0, 33330), k4a.WHITEBALANCE: (0, 5000), k4a.GAIN: (1, 128),
                         k4a.POWERLINE_FREQUENCY: (1, 2)}  # fmt: skip
        self.stuck: set[int] = set()  # controls that stay automatic
        self.refused: set[str] = set()  # functions that fail
        self.started: k4a.DeviceConfiguration | None = None
        self.open: set[int] = set()
        self.handles: dict[int, Any] = {}  # captures and images that have not been released
        self._numbers = itertools.count(1000)
        self._handler: Any = None
        self._callbacks = {name: self._callback(name) for name in PROTOTYPES}

    def __getattr__(self, name: str) -> Any:
        return self._callbacks[name]

    def driver(self, now_s: Callable[[], float]) -> K4aDevice:
        """The camera's driver, on this library."""
        return K4aDevice(self, now_s)

    def _callback(self, name: str) -> Any:
        result, arguments = PROTOTYPES[name]
        short = name.removeprefix("k4a_")
        answer: Any = getattr(type(self), f"_{short}", None)
        if answer is not None:
            answer = partial(answer, self)
        elif short in IMAGES:
            answer = partial(self._image_of, name=IMAGES[short])
        else:
            answer = partial(self._fact_of, name=FACTS[short])
        return ctypes.CFUNCTYPE(result, *arguments)(answer)

    def _fact_of(self, image: int, name: str) -> int:
        return int(getattr(self.handles[image], name))

    def _set_debug_message_handler(self, handler: Any, context: Any, level: int) -> int:
        self._handler = handler if handler else None
        return k4a.SUCCEEDED

    def _complain(self, text: bytes) -> int:
        if self._handler is not None:
            self._handler(None, k4a.LOG_ERROR, b"usbcommand.c", 366, text)
        return k4a.FAILED

    def _device_get_installed_count(self) -> int:
        return len(self.serials)

    def _device_open(self, index: int, handle: Any) -> int:
        if self.serials[index] in self.busy or "open" in self.refused:
            return self._complain(b"libusb device(s) are all unavailable")
        handle[0] = index + 1
        self.open.add(index + 1)
        return k4a.SUCCEEDED

    def _device_close(self, handle: int) -> None:
        self.open.remove(handle)

    def _device_get_serialnum(self, handle: int, text: int | None, size: Any) -> int:
        serial = self.serials[handle - 1].encode() + b"\0"
        if text is None or size[0] < len(serial):
            size[0] = len(serial)
            return k4a.TOO_SMALL
        ctypes.memmove(text, serial, len(serial))
        return k4a.SUCCEEDED

    def _device_get_version(self, handle: int, version: Any) -> int:
        version[0].rgb = k4a.Version(1, 6, 110)
        version[0].depth = k4a.Version(1, 6, 80)
        return k4a.SUCCEEDED

    def _device_get_calibration(self, handle: int, depth_mode: int, colour_mode: int, calibration: Any) -> int:
        if "calibration" in self.refused:
            return k4a.FAILED
        assert (depth_mode, colour_mode) == (2, 1)
        calibration[0] = self.calibration
        return k4a.SUCCEEDED

    def _device_get_color_control(self, handle: int, command: int, mode: Any, value: Any) -> int:
        mode[0], value[0] = self.controls[command]
        return k4a.SUCCEEDED

    def _device_set_color_control(self, handle: int, command: int, mode: int, value: int) -> int:
        if "control" in self.refused:
            return self._complain(b"failed to set color control")
        steps = (500, 1250, 2500, 8330, 16670, 33330) if self.controls[k4a.POWERLINE_FREQUENCY][1] == 2 else (
            500, 1250, 2500, 10000, 20000, 30000)  # fmt: skip
        if command == k4a.EXPOSURE_TIME_ABSOLUTE:
            value = next(step for step in steps if step >= value)
        if command not in self.stuck:
            self.controls[command] = mode, value
        return k4a.SUCCEEDED

    def _device_start_cameras(self, handle: int, configuration: Any) -> int:
        if "start" in self.refused:
            self._complain(b"Depth engine create and initialize failed with error code: 204")
            return self._complain(b"depthengine_start() returned failure")
        self.started = k4a.DeviceConfiguration.from_buffer_copy(configuration[0])
        return k4a.SUCCEEDED

    def _device_stop_cameras(self, handle: int) -> None:
        self.started = None

    def _device_get_capture(self, handle: int, capture: Any, timeout_ms: int) -> int:
        shown = self.next_shown()
        if shown == "timeout":
            return k4a.TIMEOUT
        if isinstance(shown, str):
            return self._complain(b"capturesync_get_capture() device is gone")
        capture[0] = self._hand_out(self._images(shown))
        return k4a.SUCCEEDED

    def _images(self, shown: Shown) -> dict[str, _Image]:
        device_usec = round(1e6 * (shown.t_s - BOOT_S))
        system_nsec = round(1e9 * (shown.t_s + DELAY_S + shown.late_s)) if shown.stamped else 0
        pixels = np.full((48, 64, 3), shown.grey, np.uint8)
        jpeg = cv2.imencode(".jpg", pixels)[1].tobytes()
        stamps = (device_usec, system_nsec, self.controls[k4a.EXPOSURE_TIME_ABSOLUTE][1])
        images = {}
        if shown.has_colour:
            images["colour"] = _Image(k4a.COLOR_MJPG, _buffer(jpeg), len(jpeg), 64, 48, 0, *stamps)
        rows = np.full((36, 40 + PADDING), 9999, "<u2")
        for name, kind, value in (("depth", k4a.DEPTH16, shown.depth_mm), ("infrared", k4a.IR16, 3 * shown.depth_mm)):
            rows[:, :40] = value
            images[name] = _Image(kind, _buffer(rows.tobytes()), rows.nbytes, 40, 36, 2 * (40 + PADDING), *stamps)
        if not shown.has_infrared:
            del images["infrared"]
        return images

    def _hand_out(self, what: Any) -> int:
        number = next(self._numbers)
        self.handles[number] = what
        return number

    def _capture_release(self, capture: int) -> None:
        del self.handles[capture]

    def _image_of(self, capture: int, name: str) -> int | None:
        image = self.handles[capture].get(name)
        return None if image is None else self._hand_out(image)

    def _image_get_buffer(self, image: int) -> int:
        return ctypes.addressof(self.handles[image].content)

    def _image_get_white_balance(self, image: int) -> int:
        return self.controls[k4a.WHITEBALANCE][1]

    def _image_release(self, image: int) -> None:
        del self.handles[image]


def _buffer(content: bytes) -> Any:
    return (ctypes.c_uint8 * len(content)).from_buffer_copy(content)


def frames(start_s: float, count: int, **what: Any) -> list[Shown]:
    return [Shown(start_s + i * PERIOD_S, **what) for i in range(count)]


class ThreadedChild:
    """A camera's process that is a thread of this one: `hw.child.Child` as `CameraProcess` uses it."""

    def __init__(self, make: Make, now_s: Callable[[], float]) -> None:
        self._program, theirs = Pipe()
        self._thread = threading.Thread(target=self._serve, args=(theirs, LiveCamera(make, now_s)), daemon=True)
        self._thread.start()

    @staticmethod
    def _serve(program: Connection, camera: LiveCamera) -> None:
        with program:
            serve(program, camera)

    def send(self, request: object) -> None:
        self._program.send(request)

    def answers(self, within_s: float) -> bool:
        return self._program.poll(within_s)

    def receive(self) -> Any:
        return self._program.recv()

    def close(self) -> None:
        self._program.close()
        self._thread.join()


def threaded(make: Make, now_s: Callable[[], float], serial: str | None = None, **options: Any) -> CameraProcess:
    """A camera in a thread of this process."""

    def start() -> Any:
        return ThreadedChild(make, now_s)

    return CameraProcess(serial, start=start, answer_s=60.0, step_s=60.0, **options)


def camera_on(fake: FakeK4a, serial: str | None = None, **options: Any) -> CameraProcess:
    return threaded(fake.driver, fake.clock.now_s, serial, **options)


@contextmanager
def running(fake: FakeK4a, serial: str | None = None, **options: Any) -> Iterator[CameraProcess]:
    """A camera on `fake` that has seen 20 images, from 100 s on."""
    camera = camera_on(fake, serial, **options)
    enter(camera, lambda: fake.show(*frames(100.0, 20)))
    try:
        yield camera
    finally:
        fake.end()
        camera.__exit__()


def kinect_library(made: FakeK4a) -> FakeK4a:
    """The stand-in with the calibration that fits its images of 64 x 48 and 40 x 36."""
    raw = made.calibration
    sizes = ((raw.color_camera_calibration, 64, 48), (raw.depth_camera_calibration, 40, 36))
    for camera, width, height in sizes:
        camera.resolution_width, camera.resolution_height = width, height
        camera.intrinsics.parameters[:4] = [width / 2, height / 2, 60.0, 60.0]
    for source in raw.extrinsics:
        for pose in source:
            pose.rotation[:] = np.eye(3).ravel().tolist()
    return made


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
            if fifo := os.environ.get("ADAPTSIM_STAGED_HANG"):
                Path(fifo).open("w").close()  # returns once a test reads it
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


def live(now_s: Callable[[], float]) -> Device:
    """`hw.camera.served.Make`."""
    return kinect_library(LiveK4a("A1")).driver(now_s)
