"""A camera that shows given frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self

from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame


class FakeCamera:
    """Hands out `still` for every snapshot, and what `recording` gives for every recording.

    `recording(number)` is called with the number of the recording (from 1) when it ends; it may raise CameraError.
    """

    def __init__(self, model: CameraModel, still: Frame, recording: Callable[[int], Sequence[Frame]]) -> None:
        self._model, self._still, self._recording = model, still, recording
        self._connected = self._running = False
        self._count = 0

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = self._running = False

    def model(self) -> CameraModel:
        """See `hw.ports.Camera`."""
        return self._model

    def snapshot(self) -> Frame:
        """See `hw.ports.Camera`."""
        self._need_connection()
        return self._still

    def start_recording(self) -> None:
        """See `hw.ports.Camera`."""
        self._need_connection()
        if self._running:
            raise CameraError("the camera is recording already: call stop_recording first")
        self._running = True

    def stop_recording(self) -> Sequence[Frame]:
        """See `hw.ports.Camera`."""
        self._need_connection()
        if not self._running:
            raise CameraError("the camera is not recording: call start_recording first")
        self._running = False
        self._count += 1
        return tuple(self._recording(self._count))

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the fake camera is not connected: use it inside a `with` block")
