"""The process that speaks to the camera: `python -m hw.camera.served`. If a driver hangs, only this process hangs.

It ends when the program ends: at once if it is idle, within a second if the driver blocks it.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any, Protocol

from hw.camera import k4a_library
from hw.camera.grabber import CameraRecording, Capture, DeviceClock, Grabber, TimedCapture
from hw.camera.k4a_device import RATE_HZ, ColourSettings, K4aDevice
from hw.camera.probe import probe_k4a
from hw.child import Call
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel

ORPHAN_S = 1.0
"""How long a driver may block the process after the program has ended."""
OPEN, END_FILM = "open", "end_film"
"""The calls with an answer of their own; the others are `shot`, `start_recording` and `newest` of `LiveCamera`."""


class Device(Protocol):
    """The driver of one camera. Each method may raise CameraError or DeviceUnavailable."""

    modes: tuple[str, str]  # of colour and depth

    def open(self, serial: str | None) -> None:
        """Open the camera with this serial number, or the only one."""

    def model(self) -> CameraModel:
        """The factory calibration, for the modes in use."""

    def set_colour(self, settings: ColourSettings) -> ColourSettings:
        """Fix exposure, white balance and gain; return the values that the device then reports."""

    def start(self, *, infrared: bool) -> None:
        """Colour and depth at 30 FPS, exposed together."""

    def next_capture(self) -> Capture | None:
        """The next capture with all images; None if none came within half a second, or an image is missing."""

    def close(self) -> None:
        """Stop and close; safe to call again."""


Make = Callable[[Callable[[], float]], Device]
"""The arm's clock -> a camera that is not open yet. Raises DeviceUnavailable without its library or a camera."""


def kinect(now_s: Callable[[], float]) -> Device:
    """`Make` of an Azure Kinect or a Femto Bolt. A child process checks first whether libk4a finds one."""
    report = probe_k4a()
    report.require()
    assert report.library is not None
    return K4aDevice(k4a_library.load(report.library), now_s)


class LiveCamera:
    """A camera that takes images from `open` to `close`, each timed on the arm's clock."""

    def __init__(self, make: Make, now_s: Callable[[], float] = time.monotonic) -> None:
        """`now_s` is the arm's clock: the monotonic one, which libk4a stamps with too."""
        self._make, self._now_s = make, now_s
        self._device: Device | None = None
        self._grabber: Grabber | None = None
        self._facts: dict[str, Any] = {}

    def open(
        self,
        progress: Callable[[str], None],
        serial: str | None,
        settings: ColourSettings,
        infrared: bool,
        latency_s: float,
    ) -> CameraModel:
        """Connect, in about three seconds: probe, start, and map the device's clock.

        `progress` is called with the name of each step before it begins. Raises DeviceUnavailable without library or
        camera, CameraError if the camera does not start.
        """
        progress("looking for cameras")
        device = self._device = self._make(self._now_s)
        try:
            progress("opening the camera and reading its calibration")
            device.open(serial)
            model, reported = device.model(), device.set_colour(settings)
            progress("starting the cameras")
            device.start(infrared=infrared)
            progress("waiting for the first images")
            clock = DeviceClock(delay_s=0.5e-6 * reported.exposure_us + latency_s)
            self._grabber = Grabber(device.next_capture, clock, RATE_HZ)
            self._grabber.start()
        except BaseException:
            self.close()
            raise
        self._facts = {
            "serial": model.serial,
            "modes": list(device.modes),
            "settings": asdict(reported),
            "latency_s": latency_s,
        }
        return model

    def close(self) -> None:
        """Stop and close; safe to call again."""
        if self._grabber is not None:
            self._grabber.stop()
            self._grabber = None
        if self._device is not None:
            self._device.close()
            self._device = None

    def shot(self) -> TimedCapture:
        """The first image exposed from now on. Raises CameraError."""
        return self._running.shot_after(self._now_s())

    def start_recording(self) -> None:
        """Raises CameraError if a recording runs already, or the camera is gone."""
        self._running.keep_from(self._now_s())

    def end_film(self) -> CameraRecording:
        """End the recording: everything exposed since its start, complete or not.

        Raises CameraError if none runs, or the camera is gone.
        """
        return self._running.film_until(self._now_s())

    def newest(self) -> bytes | None:
        """The newest colour image as JPEG, at once. Raises DeviceUnavailable."""
        return self._running.newest()

    def facts(self, film: CameraRecording | None = None) -> dict[str, Any]:
        """Facts for a session's record: the camera, its settings, and the quality of its last recording."""
        if film is None:
            return self._facts | {"recording": None}
        last = {
            "frames": len(film.shots),
            "dropped": film.dropped,
            "longest_gap_s": film.longest_gap_s,
            "clock_spread_s": film.clock.spread_s,
            "exposure_us_and_white_balance_K": sorted(
                {(shot.captured.exposure_us, shot.captured.white_balance_K) for shot in film.shots}
            ),
        }
        return self._facts | {"recording": last}

    @property
    def _running(self) -> Grabber:
        if self._grabber is None:
            raise DeviceUnavailable("the camera is not connected")
        return self._grabber


def serve(program: Connection, camera: LiveCamera) -> None:
    """Answer calls until the program hangs up.

    `open`: the name of each step, then (model, facts). `end_film`: (film without its images, facts, their number), then
    each image. A call that fails is answered with its error.
    """
    try:
        with suppress(EOFError, OSError):
            while True:
                call: Call = program.recv()
                try:
                    if call.method == OPEN:
                        program.send((camera.open(program.send, *call.arguments), camera.facts()))
                    elif call.method == END_FILM:
                        film = camera.end_film()
                        program.send((replace(film, shots=()), camera.facts(film), len(film.shots)))
                        for shot in film.shots:
                            program.send(shot)
                    else:
                        program.send(getattr(camera, call.method)())
                except (CameraError, DeviceUnavailable) as error:
                    program.send(error)
    finally:
        camera.close()


def end_with(pipe: int) -> None:
    """End this process soon after the program has closed its end of the pipe, even if a driver blocks."""

    def watch() -> None:
        with suppress(OSError):
            while os.read(pipe, 64):
                pass
        threading.Event().wait(ORPHAN_S)
        os._exit(1)

    threading.Thread(target=watch, name="program", daemon=True).start()


def main(connection_fd: str, pipe_fd: str, maker: str) -> None:
    """Serve one program; the arguments are two file descriptors and a `Make` as module:function."""
    end_with(int(pipe_fd))
    with Connection(int(connection_fd)) as program:
        serve(program, LiveCamera(partial(loaded, maker)))


def loaded(maker: str, now_s: Callable[[], float]) -> Device:
    """A `Make` that calls the one named module:name. Raises DeviceUnavailable with the reason if that fails."""
    module, _, name = maker.partition(":")
    try:
        make: Make = getattr(import_module(module), name)
    except Exception as error:
        raise DeviceUnavailable(
            f"the camera's adapter {maker} cannot be loaded ({type(error).__name__}: {error}): mend or install it"
        ) from error
    return make(now_s)


if __name__ == "__main__":
    main(*sys.argv[1:])
