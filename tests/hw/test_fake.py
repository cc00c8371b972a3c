"""The scripted devices that have no contract suite of their own."""

from __future__ import annotations

import numpy as np
import pytest

from hw.errors import CameraError, DeviceUnavailable
from hw.fake import FakeBench, FakeCamera, FakeClock
from hw.types import CameraModel, Frame, Intrinsics

INTRINSICS = Intrinsics(4, 3, np.diag([2.0, 2.0, 1.0]))
MODEL = CameraModel("fake", INTRINSICS, INTRINSICS, np.eye(4))


def frame(t_s: float) -> Frame:
    return Frame(t_s, np.zeros((3, 4, 3), np.uint8), np.zeros((3, 4), np.uint16))


def test_sleeping_moves_the_clock_and_nothing_else_does() -> None:
    clock = FakeClock(5.0)
    assert clock.now_s() == clock.now_s() == 5.0
    clock.sleep(0.25)
    assert clock.now_s() == 5.25
    with pytest.raises(ValueError, match="0 or more"):
        clock.sleep(-1.0)


def test_the_camera_shows_what_it_was_given() -> None:
    still = frame(0.0)
    with FakeCamera(MODEL, still, lambda number: [frame(number), frame(number + 0.5)]) as camera:
        assert camera.snapshot() is still
        camera.start_recording()
        assert [f.t_s for f in camera.stop_recording()] == [1.0, 1.5]
        camera.start_recording()
        assert [f.t_s for f in camera.stop_recording()] == [2.0, 2.5]


def test_the_camera_must_record_before_it_stops() -> None:
    with FakeCamera(MODEL, frame(0.0), lambda _: []) as camera, pytest.raises(CameraError, match="start_recording"):
        camera.stop_recording()


def test_the_camera_must_be_entered() -> None:
    camera = FakeCamera(MODEL, frame(0.0), lambda _: [])
    for use in (camera.snapshot, camera.start_recording, camera.stop_recording):
        with pytest.raises(DeviceUnavailable):
            use()


def test_a_recording_may_fail() -> None:
    def fail(number: int) -> list[Frame]:
        raise CameraError(f"recording {number} timed out")

    with FakeCamera(MODEL, frame(0.0), fail) as camera:
        camera.start_recording()
        with pytest.raises(CameraError, match="recording 1 timed out"):
            camera.stop_recording()
        with pytest.raises(CameraError, match="not recording"):
            camera.stop_recording()


def test_the_bench_remembers() -> None:
    bench = FakeBench()
    bench.place(np.array([0.6, 0.1]), 2, 1)
    (placing,) = bench.placed
    assert (placing.trial, placing.attempt) == (2, 1)
    np.testing.assert_array_equal(placing.xy_m, [0.6, 0.1])
