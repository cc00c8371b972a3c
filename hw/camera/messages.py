"""The messages between the program and the camera's process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hw.camera.clock import ClockMap
from hw.camera.grabber import TimedCapture
from hw.camera.k4a_device import ColourSettings
from hw.types import CameraModel


@dataclass(frozen=True)
class Open:
    """Connect to a camera, as `hw.camera.k4a.LiveCamera` takes it."""

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
    """Ask for all images kept. The answer: a `Recorded`, then each image."""


Request = Open | Snapshot | StartRecording | StopRecording


@dataclass(frozen=True)
class Step:
    """The next step of connecting; not the final answer."""

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
    """A recording is over; `shots` images follow, each a `TimedCapture`."""

    shots: int
    dropped: int
    longest_gap_s: float
    clock: ClockMap
    facts: dict[str, Any]


@dataclass(frozen=True)
class Failed:
    """The request failed: CameraError, or DeviceUnavailable if there is no camera."""

    text: str
    unavailable: bool = False


Answer = Step | Opened | TimedCapture | Started | Recorded | Failed
