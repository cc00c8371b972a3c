"""The camera that shows recorded frames."""

from __future__ import annotations

import numpy as np
import pytest

from hw.camera.replay import RecordedCamera, Take
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame, Intrinsics

PINHOLE = Intrinsics(8, 6, np.array([[10.0, 0, 4], [0, 10.0, 3], [0, 0, 1]]))
MODEL = CameraModel("r", PINHOLE, PINHOLE, np.eye(4))


def frame(t_s: float) -> Frame:
    return Frame(t_s, np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16))


def take(t_s: float, count: int) -> Take:
    return Take(frame(t_s), tuple(frame(t_s + 1 + i / 30) for i in range(count)))


def test_each_recording_shows_the_next_take() -> None:
    takes = [take(10.0, 3), take(20.0, 5)]
    with RecordedCamera(MODEL, takes) as camera:
        assert camera.model() is MODEL
        assert camera.snapshot() is takes[0].still and camera.snapshot() is takes[0].still
        camera.start_recording()
        assert camera.stop_recording() == takes[0].film
        assert camera.snapshot() is takes[1].still
        camera.start_recording()
        assert len(camera.stop_recording()) == 5
        assert camera.snapshot() is takes[1].still
        with pytest.raises(CameraError, match="2 films"):
            camera.start_recording()


def test_out_of_turn_and_out_of_order() -> None:
    camera = RecordedCamera(MODEL, [take(1.0, 2)])
    with pytest.raises(DeviceUnavailable, match="not connected"):
        camera.snapshot()
    with camera:
        with pytest.raises(CameraError, match="not recording"):
            camera.stop_recording()
        camera.start_recording()
        with pytest.raises(CameraError, match="recording already"):
            camera.start_recording()
    with pytest.raises(ValueError, match="order"):
        Take(frame(0.0), (frame(1.0), frame(1.0)))
    with pytest.raises(ValueError, match="one take"):
        RecordedCamera(MODEL, [])
