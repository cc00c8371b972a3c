"""An Azure Kinect, or a Femto Bolt, behind `hw.ports.Camera`: colour 1280 x 720 and depth 640 x 576 at 30 FPS, exposed
together, each with the device's own time, which is mapped to the arm's clock (the host's monotonic clock).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Self

from hw.camera import k4a_library
from hw.camera.clock import DeviceClock
from hw.camera.grabber import Film, Grabber, TimedCapture
from hw.camera.k4a_device import COLOUR_MODE, DEPTH_MODE, RATE_HZ, ColourSettings, K4aDevice
from hw.camera.k4a_library import K4aLibrary
from hw.camera.probe import probe_k4a
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame

MOST_LOST = 0.25
"""A recording that lacks a larger share of its images is refused: too little is known of the motion."""

_log = logging.getLogger(__name__)


def open_kinect(
    serial: str | None = None,
    settings: ColourSettings | None = None,
    *,
    infrared: bool = False,
    latency_s: float = 0.0,
) -> KinectCamera:
    """The camera with this serial number, or the only one; connects on entering.

    `latency_s` is the time from the end of an exposure to its arrival at the host, as the calibration's swing finds it;
    half of the exposure is known and taken off by itself. With `infrared` every frame carries what the depth camera
    sees, for calibrating.
    """
    return KinectCamera(serial, settings or ColourSettings(), infrared=infrared, latency_s=latency_s)


def probed_library() -> K4aLibrary:
    """libk4a, after a child process has shown that it can be loaded and sees a camera. Raises DeviceUnavailable."""
    report = probe_k4a()
    report.require()
    assert report.library is not None
    return k4a_library.load(report.library)


class KinectCamera:
    """Entering takes about three seconds: probing, starting, and getting to know the device's clock."""

    def __init__(
        self,
        serial: str | None,
        settings: ColourSettings,
        *,
        infrared: bool = False,
        latency_s: float = 0.0,
        library: Callable[[], K4aLibrary] = probed_library,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`now_s` is the arm's clock: the monotonic one, which libk4a stamps with too. Raises ValueError."""
        if latency_s < 0.0:
            raise ValueError(f"a camera's latency of {latency_s:g} s: it is at least 0")
        self._serial, self._wanted, self._infrared = serial, settings, infrared
        self._latency_s, self._library, self._now_s = latency_s, library, now_s
        self._device: K4aDevice | None = None
        self._grabber: Grabber | None = None
        self._model: CameraModel | None = None
        self._settings: ColourSettings | None = None
        self._film: Film | None = None

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable without library or camera, CameraError when it does not start."""
        device = self._device = K4aDevice(self._library(), self._now_s)
        try:
            device.open(self._serial)
            self._model = device.model()
            self._settings = device.set_colour(self._wanted)
            device.start(infrared=self._infrared)
            clock = DeviceClock(delay_s=0.5e-6 * self._settings.exposure_us + self._latency_s)
            self._grabber = Grabber(device.next_capture, clock, RATE_HZ)
            self._grabber.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        if self._grabber is not None:
            self._grabber.stop()
            self._grabber = None
        if self._device is not None:
            self._device.close()
            self._device = None

    def model(self) -> CameraModel:
        """Factory calibration; known from the first entering on. Raises DeviceUnavailable before."""
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
        """For a session's record: which camera, how it was set, and how its last recording went."""
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
            "modes": [COLOUR_MODE, DEPTH_MODE],
            "settings": self.settings.as_json(),
            "latency_s": self._latency_s,
            "recording": last,
        }

    def snapshot(self) -> Frame:
        """The first frame exposed from now on. Raises CameraError."""
        return _frame(self._running.shot_after(self._now_s()))

    def start_recording(self) -> None:
        """Raises CameraError when one runs, or the camera is gone."""
        self._running.keep_from(self._now_s())

    def stop_recording(self) -> Sequence[Frame]:
        """Everything exposed since `start_recording`, decoded. Raises CameraError, also when too much was lost."""
        film = self._film = self._running.film_until(self._now_s())
        if film.dropped:
            _log.warning("camera %s dropped %d of %d frames", self.model().serial, film.dropped,
                         film.dropped + len(film.shots))  # fmt: skip
        if not film.shots or film.lost > MOST_LOST:
            raise CameraError(
                f"the recording lacks {film.dropped} of {film.dropped + len(film.shots)} frames ({film.lost:.0%}, at "
                f"most {MOST_LOST:.0%} may be missing; longest gap {film.longest_gap_s:.2f} s): give the camera a USB "
                "controller of its own, close other programs, and do the trial again"
            )
        with ThreadPoolExecutor(max_workers=2) as pool:  # OpenCV releases the interpreter while it decodes
            return tuple(pool.map(_frame, film.shots))

    @property
    def _running(self) -> Grabber:
        if self._grabber is None:
            raise _closed()
        return self._grabber


def _frame(shot: TimedCapture) -> Frame:
    return shot.captured.frame(shot.t_s)


def _closed() -> DeviceUnavailable:
    return DeviceUnavailable("the camera is not connected: use it inside a `with` block")
