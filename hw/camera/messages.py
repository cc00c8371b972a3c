"""What the program and the camera's process say to each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hw.camera.clock import ClockMap
from hw.camera.grabber import TimedCapture
from hw.camera.k4a_device import ColourSettings
from hw.types import CameraModel


@dataclass(frozen=True)
class Open:
    """Connect to a camera, as `hw.camera.k4a.KinectCamera` takes it."""

    serial: str | None
    settings: ColourSettings
    infrared: bool
    latency_s: float


@dataclass(frozen=True)
class Snapshot:
    """Ask for the first image exposed from now on."""


@dataclass(frozen=True)
class StartRecording:
    """Keep every image from now on."""


@dataclass(frozen=True)
class StopRecording:
    """Ask for all images that were kept: a `Recorded`, then each of them."""


Request = Open | Snapshot | StartRecording | StopRecording


@dataclass(frozen=True)
class Step:
    """What the process does next while it connects; no answer yet."""

    doing: str


@dataclass(frozen=True, eq=False)
class Opened:
    """The camera runs."""

    model: CameraModel
    settings: ColourSettings
    facts: dict[str, Any]


@dataclass(frozen=True)
class Started:
    """A recording runs."""


@dataclass(frozen=True)
class Recorded:
    """A recording is over; so many `TimedCapture`s follow."""

    shots: int
    dropped: int
    longest_gap_s: float
    clock: ClockMap
    facts: dict[str, Any]


@dataclass(frozen=True)
class Failed:
    """It went wrong: CameraError, or DeviceUnavailable where there is no camera."""

    text: str
    unavailable: bool = False


Answer = Step | Opened | TimedCapture | Started | Recorded | Failed
