"""A camera that replays stored frames, so that a session can be tracked again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame


@dataclass(frozen=True, eq=False)
class Take:
    """The pictures of one motion: a still before it, and its film."""

    still: Frame
    film: tuple[Frame, ...]

    def __post_init__(self) -> None:
        if any(later.t_s <= earlier.t_s for earlier, later in pairwise(self.film)):
            raise ValueError("the frames of a film must be in order of time")


class RecordedCamera:
    """A `hw.ports.Camera`: every snapshot shows the still of the present take, every recording is its film.

    Ending a recording moves to the next take; the still of the last take stays. Times are those of the recording.
    """

    def __init__(self, model: CameraModel, takes: Sequence[Take]) -> None:
        """Raises ValueError without any take."""
        if not takes:
            raise ValueError("a recorded camera needs at least one take")
        self._model, self._takes = model, tuple(takes)
        self._number = 0
        self._connected = self._running = False

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = self._running = False

    def model(self) -> CameraModel:
        """See `hw.ports.Camera`."""
        return self._model

    def snapshot(self) -> Frame:
        """See `hw.ports.Camera`: the still of the present take."""
        self._need_connection()
        return self._takes[min(self._number, len(self._takes) - 1)].still

    def start_recording(self) -> None:
        """Raises CameraError if a recording runs, or every film has been shown."""
        self._need_connection()
        if self._running:
            raise CameraError("the camera is recording already: call stop_recording first")
        if self._number >= len(self._takes):
            raise CameraError(f"all {len(self._takes)} films of this recording have been shown: open it again")
        self._running = True

    def stop_recording(self) -> Sequence[Frame]:
        """See `hw.ports.Camera`: the film of the present take; the next take follows."""
        self._need_connection()
        if not self._running:
            raise CameraError("the camera is not recording: call start_recording first")
        self._running = False
        self._number += 1
        return self._takes[self._number - 1].film

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the recorded camera is not connected: use it inside a `with` block")
