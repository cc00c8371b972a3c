"""A thread that takes every image from the camera as it comes, so that the driver drops none.

It keeps the newest image, and during a recording all of them. While libk4a waits, ctypes lets other threads run.

It maps the camera's own clock to the clock of this machine. The device stamps the middle of each exposure with its own
clock; the host stamps the arrival of the image. The difference is the offset of the two clocks plus a varying, never
negative delay (transfer, scheduling). So the smallest difference within a window is the best estimate, and one late
image changes nothing.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.errors import CameraError, HardwareError
from hw.types import Frame

WINDOW_S = 20.0
"""A quartz drifts by at most some 50 ppm against another: 1 ms within the window."""
LEAST_PAIRS = 15
"""The images of half a second. With fewer, the smallest difference may still come from a late image."""
JUMP_S = 0.02
"""An image that arrives this much (s) before the fastest of half a second shows that the device's clock has jumped
ahead."""
PAUSE_S, PAUSE_PAIRS = 0.06, 8
"""If this many images in a row all arrive this much (s) later than the fastest, the device's clock has paused."""


@dataclass(frozen=True)
class ClockMap:
    """Seconds of the device's clock -> seconds of the host's monotonic clock, for one stretch of images."""

    offset_s: float
    spread_s: float  # median less smallest difference: how unevenly images arrive
    pairs: int  # pairs of stamps behind the map

    def host_s(self, device_s: float) -> float:
        """Seconds on the host's clock at `device_s` on the device's clock."""
        return device_s + self.offset_s


class DeviceClock:
    """Collects pairs of stamps; `delay_s` is the smallest possible time from the middle of an exposure to its arrival.

    Any further delay stays in the offset: all stamps are then late by the same amount, which the calibration's swing
    measures (`calib.timing`).
    """

    def __init__(self, delay_s: float = 0.0) -> None:
        if delay_s < 0.0:
            raise ValueError(f"a delay of {delay_s:g} s: it must be 0 or more")
        self._delay_s = delay_s
        self._pairs: deque[tuple[float, float]] = deque()  # device_s, host_s - device_s
        self.jumps = 0  # times that the device's clock was set, or stood still, while it ran

    def add(self, device_s: float, arrived_s: float) -> None:
        """Add one image: the middle of its exposure on the device's clock, and its arrival on the host's.

        A device clock that jumps back or ahead was set again, and one that stands still or pauses has lost time. In
        both cases, earlier pairs are dropped.
        """
        stands = bool(self._pairs) and device_s <= self._pairs[-1][0]
        ahead = self.is_settled and arrived_s - device_s < self._least_s - JUMP_S
        if stands or ahead:
            self._pairs.clear()
            self.jumps += 1
        self._pairs.append((device_s, arrived_s - device_s))
        latest = list(self._pairs)[-PAUSE_PAIRS:]
        if len(self._pairs) > LEAST_PAIRS and min(late_s for _, late_s in latest) > self._least_s + PAUSE_S:
            self._pairs = deque(latest)
            self.jumps += 1
        while self._pairs[0][0] < device_s - WINDOW_S:
            self._pairs.popleft()

    @property
    def _least_s(self) -> float:
        """The smallest difference of the two clocks."""
        return min(difference_s for _, difference_s in self._pairs)

    @property
    def is_settled(self) -> bool:
        """Whether enough pairs of stamps have come."""
        return len(self._pairs) >= LEAST_PAIRS

    def map(self) -> ClockMap:
        """Raises CameraError while no image has come."""
        if not self._pairs:
            raise CameraError("the camera's clock is not known before the first image: wait for one")
        differences_s = sorted(difference_s for _, difference_s in self._pairs)
        least_s, median_s = differences_s[0], differences_s[len(differences_s) // 2]
        return ClockMap(least_s - self._delay_s, median_s - least_s, len(differences_s))


@dataclass(frozen=True, eq=False)
class Capture:
    """One instant. The colour image is still a JPEG, so that nothing is decoded while the arm moves."""

    device_s: float  # middle of the colour image's exposure, on the device's clock
    arrived_s: float  # on the host's monotonic clock
    jpeg: bytes
    depth_mm: NDArray[np.uint16]  # (Hd, Wd)
    infrared: NDArray[np.uint16] | None  # (Hd, Wd)
    exposure_us: int  # of the colour image, as the device reports; 0: not reported
    white_balance_K: int

    def frame(self, t_s: float) -> Frame:
        """Decoded, with its time on the arm's clock. Raises CameraError."""
        return Frame(t_s, decode_jpeg(self.jpeg), self.depth_mm, self.infrared)


def decode_jpeg(jpeg: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) RGB. Raises CameraError."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise CameraError(f"a colour image of {len(jpeg)} bytes cannot be decoded: check the camera's USB cable")
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)


MOST_MISSES = 4
"""Waits of half a second without a complete image, after which the camera counts as gone."""
LONGEST_S = 60.0
"""The longest recording, in images: about 2 GB in memory."""


@dataclass(frozen=True)
class TimedCapture:
    """One instant with its time on the host's clock."""

    t_s: float
    captured: Capture


@dataclass(frozen=True)
class CameraRecording:
    """One recording, with the number of images that were dropped."""

    shots: tuple[TimedCapture, ...]  # in order of time
    dropped: int  # images missing between start and end
    longest_gap_s: float
    clock: ClockMap

    @property
    def lost(self) -> float:
        """Share of images that are missing, 0 to 1."""
        return self.dropped / max(self.dropped + len(self.shots), 1)


class Grabber:
    """Owns the thread. `next_capture` waits for the next image and returns None if none came in time."""

    def __init__(self, next_capture: Callable[[], Capture | None], clock: DeviceClock, rate_hz: float) -> None:
        self._next, self._clock, self._rate_hz = next_capture, clock, rate_hz
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._wanted, self._ended = True, False
        self._error: HardwareError | None = None
        self._newest: Capture | None = None
        self._kept: list[Capture] | None = None
        self._since_s, self._jumps = 0.0, 0

    def start(self) -> None:
        """Start, and return once the two clocks are mapped, half a second later. Raises CameraError."""
        self._thread.start()
        self._wait(lambda: self._clock.is_settled)

    def stop(self) -> None:
        """End the thread; safe to call again, and before `start`."""
        self._wanted = False
        if self._thread.ident is not None:
            self._thread.join()

    def shot_after(self, t_s: float) -> TimedCapture:
        """The newest image, exposed (middle of exposure) at `t_s` of the host's clock or later. Raises CameraError."""
        with self._changed:
            self._wait(lambda: self._newest_s() >= t_s)
            assert self._newest is not None
            return TimedCapture(self._newest_s(), self._newest)

    def newest(self) -> bytes | None:
        """The newest colour image as JPEG, at once; None before the first."""
        captured = self._newest
        return None if captured is None else captured.jpeg

    def keep_from(self, t_s: float) -> None:
        """Begin a recording at `t_s`. Raises CameraError if a recording runs already, or the camera is gone."""
        with self._changed:
            if self._kept is not None:
                raise CameraError("the camera is recording already: call stop_recording first")
            self._wait(lambda: True)
            self._kept, self._since_s, self._jumps = [], t_s, self._clock.jumps

    def film_until(self, t_s: float) -> CameraRecording:
        """End the recording: everything exposed from its start to `t_s`. Raises CameraError."""
        with self._changed:
            if self._kept is None:
                raise CameraError("the camera is not recording: call start_recording first")
            try:
                self._wait(lambda: self._newest_s() >= t_s)
            finally:
                pending, self._kept = self._kept, None
            clock, jumps = self._clock.map(), self._clock.jumps - self._jumps
        if jumps:
            raise CameraError(
                "the camera's clock jumped or stood still during the recording, so the times of its images are "
                "unknown: repeat the trial; if it happens again, plug the camera in again"
            )
        if t_s - self._since_s > LONGEST_S:
            raise CameraError(
                f"the recording took {t_s - self._since_s:.0f} s, limit {LONGEST_S:g} s: record a shorter motion"
            )
        shots = [TimedCapture(clock.host_s(captured.device_s), captured) for captured in pending]
        within = tuple(shot for shot in shots if self._since_s <= shot.t_s <= t_s)
        dropped, gap_s = gaps([shot.t_s for shot in within], self._since_s, t_s, self._rate_hz)
        return CameraRecording(within, dropped, gap_s, clock)

    def _run(self) -> None:
        misses = 0
        try:
            while self._wanted:
                captured = self._next()
                misses = 0 if captured is not None else misses + 1
                if misses >= MOST_MISSES:
                    raise CameraError(
                        f"the camera gave no complete image for {misses} waits in a row: check that nothing else uses "
                        "its USB controller, plug it in again, and run the command again"
                    )
                if captured is not None:
                    self._take(captured)
        except HardwareError as error:
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _take(self, captured: Capture) -> None:
        with self._changed:
            self._clock.add(captured.device_s, captured.arrived_s)
            self._newest = captured
            if self._kept is not None and len(self._kept) <= LONGEST_S * self._rate_hz:
                self._kept.append(captured)
            self._changed.notify_all()

    def _newest_s(self) -> float:
        return self._clock.map().host_s(self._newest.device_s) if self._newest is not None else float("-inf")

    def _wait(self, until: Callable[[], bool]) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or until())
            if self._ended:
                why = str(self._error) if self._error else "it was closed, or its thread failed"
                raise CameraError(f"no images from the camera: {why}") from self._error


def gaps(t_s: Sequence[float], start_s: float, end_s: float, rate_hz: float) -> tuple[int, float]:
    """(images missing, longest time without one) among the stamps `t_s` of a recording from `start_s` to `end_s`."""
    if not t_s:
        return int((end_s - start_s) * rate_hz), end_s - start_s
    inner_s = [later - earlier for earlier, later in pairwise(t_s)]
    outer_s = [t_s[0] - start_s, end_s - t_s[-1]]
    missing = sum(max(round(gap_s * rate_hz) - 1, 0) for gap_s in inner_s)
    missing += sum(max(int(gap_s * rate_hz - 0.25), 0) for gap_s in outer_s)
    return missing, max([*inner_s, *outer_s])
