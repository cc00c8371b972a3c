"""Maps a camera's own clock to the clock of this machine.

The device stamps the middle of each exposure with its own clock; the host stamps the arrival of the image. The
difference is the offset of the two clocks plus a varying, never negative delay (transfer, scheduling). So the smallest
difference within a window is the best estimate, and one late image changes nothing.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from hw.errors import CameraError

WINDOW_S = 20.0
"""A quartz drifts by at most some 50 ppm against another: 1 ms within the window."""
LEAST_PAIRS = 15
"""Half a second of images. With fewer, even the smallest difference may belong to a late image."""
JUMP_S = 0.02
"""No image can arrive so much faster than the fastest of half a second: the device's clock has jumped ahead."""


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

    def __init__(self, delay_s: float = 0.0, window_s: float = WINDOW_S) -> None:
        if delay_s < 0.0 or window_s <= 0.0:
            raise ValueError(
                f"delay {delay_s:g} s and window {window_s:g} s: the delay must be 0 or more, the window more than 0"
            )
        self._delay_s, self._window_s = delay_s, window_s
        self._pairs: deque[tuple[float, float]] = deque()  # device_s, host_s - device_s
        self.jumps = 0  # times that the device's clock was set while it ran

    def add(self, device_s: float, arrived_s: float) -> None:
        """Add one image: the middle of its exposure on the device's clock, and its arrival on the host's.

        A device clock that jumps back or ahead was set anew: earlier pairs are dropped.
        """
        back = bool(self._pairs) and device_s < self._pairs[-1][0]
        if back or (self.is_settled and arrived_s - device_s < self.map().offset_s + self._delay_s - JUMP_S):
            self._pairs.clear()
            self.jumps += 1
        self._pairs.append((device_s, arrived_s - device_s))
        while self._pairs[0][0] < device_s - self._window_s:
            self._pairs.popleft()

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
