"""A live camera behind `hw.ports.Camera`: colour and depth at 30 FPS, exposed together, with the device's own time,
which is mapped to the arm's clock (the host's monotonic clock).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, Self

from hw.camera import k4a_library
from hw.camera.capture import Captured
from hw.camera.clock import DeviceClock
from hw.camera.grabber import Film, Grabber, TimedCapture
from hw.camera.k4a_device import RATE_HZ, ColourSettings, K4aDevice
from hw.camera.k4a_library import K4aLibrary
from hw.camera.probe import probe_k4a
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame

MOST_LOST = 0.25
"""A recording that misses a larger share of its images is refused: it shows too little of the motion."""

_log = logging.getLogger(__name__)


class Device(Protocol):
    """The driver of one camera. Each method may raise CameraError or DeviceUnavailable."""

    modes: tuple[str, str]  # of colour and depth

    def open(self, serial: str | None) -> None:
        """Open the camera with this serial number, or the only one."""
        ...

    def model(self) -> CameraModel:
        """The factory calibration, for the modes in use."""
        ...

    def set_colour(self, wanted: ColourSettings) -> ColourSettings:
        """Fix exposure, white balance and gain; return the values that the device then reports."""
        ...

    def start(self, *, infrared: bool) -> None:
        """Colour and depth at 30 FPS, exposed together."""
        ...

    def next_capture(self) -> Captured | None:
        """The next capture with all images; None if none came within half a second, or an image is missing."""
        ...

    def close(self) -> None:
        """Stop and close; safe to call again."""
        ...


def kinect(now_s: Callable[[], float]) -> Device:
    """An Azure Kinect or a Femto Bolt, not open. Raises DeviceUnavailable without libk4a or a camera."""
    return K4aDevice(probed_library(), now_s)


def probed_library() -> K4aLibrary:
    """libk4a, after a child process has shown that it can be loaded and sees a camera. Raises DeviceUnavailable."""
    report = probe_k4a()
    report.require()
    assert report.library is not None
    return k4a_library.load(report.library)


class LiveCamera:
    """Entering takes about three seconds: probe, start, and map the device's clock."""

    def __init__(
        self,
        serial: str | None,
        settings: ColourSettings,
        *,
        infrared: bool = False,
        latency_s: float = 0.0,
        device: Callable[[Callable[[], float]], Device] = kinect,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`now_s` is the arm's clock: the monotonic one, which libk4a stamps with too. Raises ValueError."""
        if latency_s < 0.0:
            raise ValueError(f"a camera latency of {latency_s:g} s: it must be 0 or more")
        self._serial, self._wanted, self._infrared = serial, settings, infrared
        self._latency_s, self._driver, self._now_s = latency_s, device, now_s
        self._device: Device | None = None
        self._grabber: Grabber | None = None
        self._model: CameraModel | None = None
        self._settings: ColourSettings | None = None
        self._film: Film | None = None
        self._modes = ("", "")

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable without library or camera, CameraError if the camera does not start."""
        self.connect(lambda doing: None)
        return self

    def connect(self, progress: Callable[[str], None]) -> None:
        """Connect, as entering does; `progress` is called with the name of each step before it begins.

        Raises as entering does.
        """
        progress("looking for cameras")
        device = self._device = self._driver(self._now_s)
        try:
            progress("opening the camera and reading its calibration")
            device.open(self._serial)
            self._model = device.model()
            self._settings, self._modes = device.set_colour(self._wanted), device.modes
            progress("starting the cameras")
            device.start(infrared=self._infrared)
            progress("waiting for the first images")
            clock = DeviceClock(delay_s=0.5e-6 * self._settings.exposure_us + self._latency_s)
            self._grabber = Grabber(device.next_capture, clock, RATE_HZ)
            self._grabber.start()
        except BaseException:
            self.__exit__()
            raise

    def __exit__(self, *exc: object) -> None:
        if self._grabber is not None:
            self._grabber.stop()
            self._grabber = None
        if self._device is not None:
            self._device.close()
            self._device = None

    def model(self) -> CameraModel:
        """The factory calibration, known once the camera was entered. Raises DeviceUnavailable before that."""
        if self._model is None:
            raise _closed()
        return self._model

    @property
    def settings(self) -> ColourSettings:
        """Exposure, white balance, gain and mains frequency as the device reports them. Raises DeviceUnavailable."""
        if self._settings is None:
            raise _closed()
        return self._settings

    @property
    def film(self) -> Film | None:
        """The last recording: dropped images, longest gap, clock."""
        return self._film

    def facts(self) -> dict[str, Any]:
        """For a session's record: which camera, its settings, and the quality of its last recording."""
        film = self._film
        last = None
        if film is not None:
            seen = sorted({(shot.captured.exposure_us, shot.captured.white_balance_K) for shot in film.shots})
            last = {
                "frames": len(film.shots),
                "dropped": film.dropped,
                "longest_gap_s": film.longest_gap_s,
                "clock_spread_s": film.clock.spread_s,
                "exposure_us_and_white_balance_K": seen,
            }
        return {
            "serial": self.model().serial,
            "modes": list(self._modes),
            "settings": self.settings.as_json(),
            "latency_s": self._latency_s,
            "recording": last,
        }

    def snapshot(self) -> Frame:
        """The first frame exposed from now on. Raises CameraError."""
        return frame_of(self.shot())

    def shot(self) -> TimedCapture:
        """The raw image of a snapshot, not yet decoded. Raises CameraError."""
        return self._running.shot_after(self._now_s())

    def start_recording(self) -> None:
        """Raises CameraError when one runs, or the camera is gone."""
        self._running.keep_from(self._now_s())

    def stop_recording(self) -> Sequence[Frame]:
        """Everything exposed since `start_recording`, decoded.

        Raises CameraError, also if too many images were lost.
        """
        film = self.end_film()
        require_whole(film, self.model().serial)
        return decoded(film.shots)

    def end_film(self) -> Film:
        """End the recording and return its raw images, complete or not.

        Raises CameraError if none runs, or the camera is gone.
        """
        film = self._film = self._running.film_until(self._now_s())
        return film

    @property
    def _running(self) -> Grabber:
        if self._grabber is None:
            raise _closed()
        return self._grabber


def frame_of(shot: TimedCapture) -> Frame:
    """Decoded. Raises CameraError."""
    return shot.captured.frame(shot.t_s)


def decoded(shots: Sequence[TimedCapture]) -> Sequence[Frame]:
    """All of them, in order. Raises CameraError."""
    with ThreadPoolExecutor(max_workers=2) as pool:  # OpenCV releases the interpreter while it decodes
        return tuple(pool.map(frame_of, shots))


def require_whole(film: Film, serial: str) -> None:
    """Raises CameraError if too many images of a recording are missing; a few give only a warning."""
    every = film.dropped + len(film.shots)
    if film.dropped:
        _log.warning("camera %s dropped %d of %d frames", serial, film.dropped, every)
    if not film.shots or film.lost > MOST_LOST:
        raise CameraError(
            f"{film.dropped} of {every} frames of the recording are missing ({film.lost:.0%}, limit {MOST_LOST:.0%}; "
            f"longest gap {film.longest_gap_s:.2f} s): give the camera a USB controller of its own, close "
            "other programs, and repeat the trial"
        )


def _closed() -> DeviceUnavailable:
    return DeviceUnavailable("the camera is not connected: use it inside a `with` block")
