"""The maker's own libk4a on a real recording, against our readers. Needs no device.

ADAPTSIM_K4A_LIBRARY names libk4a, ADAPTSIM_K4ARECORD_LIBRARY libk4arecord, ADAPTSIM_KINECT_RECORDING a recording with
colour, depth and infrared; docs/guide/cameras.md says where they can be had. Run with `pytest -m slow`.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from kinect_alignment import points_in_colour
from kinect_recording import KinectRecording

from hw.camera import k4a_library
from hw.camera.grabber import Capture
from hw.camera.k4a_device import model_of, read_capture
from hw.camera.k4a_library import K4aCalibration, K4aLibrary
from hw.camera.probe import probe_k4a
from hw.types import CameraModel, Frame

NEEDED = ("ADAPTSIM_K4A_LIBRARY", "ADAPTSIM_K4ARECORD_LIBRARY", "ADAPTSIM_KINECT_RECORDING")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not all(os.environ.get(name) for name in NEEDED), reason=f"set {', '.join(NEEDED)}"),
]


class Float2(ctypes.Structure):
    _fields_ = (("x", ctypes.c_float), ("y", ctypes.c_float))


@pytest.fixture(scope="module")
def library() -> K4aLibrary:
    return k4a_library.load(os.environ[NEEDED[0]])


@pytest.fixture(scope="module")
def playback(library: K4aLibrary) -> Iterator[tuple[Capture, K4aCalibration]]:
    """First capture and calibration, as libk4arecord and our structures give them."""
    record, handle, capture = ctypes.CDLL(os.environ[NEEDED[1]]), ctypes.c_void_p(), ctypes.c_void_p()
    calibration = K4aCalibration()
    assert record.k4a_playback_open(os.environ[NEEDED[2]].encode(), ctypes.byref(handle)) == 0
    assert record.k4a_playback_get_calibration(handle, ctypes.byref(calibration)) == 0
    assert record.k4a_playback_get_next_capture(handle, ctypes.byref(capture)) == 0
    captured = read_capture(library, capture, 5.0, infrared=True)
    assert captured is not None
    yield captured, calibration
    library.k4a_capture_release(capture)
    record.k4a_playback_close(handle)


@pytest.fixture(scope="module")
def ours() -> tuple[CameraModel, Frame]:
    with KinectRecording(Path(os.environ[NEEDED[2]])) as recording:
        return recording.model(), next(recording.frames())


def test_images_and_times_agree(playback: tuple[Capture, K4aCalibration], ours: tuple[CameraModel, Frame]) -> None:
    captured, frame = playback[0], ours[1]
    assert captured.device_s == pytest.approx(frame.t_s, abs=1e-6)
    assert np.array_equal(captured.depth_mm, frame.depth_mm)
    assert captured.infrared is not None and np.array_equal(captured.infrared, frame.infrared)
    apart = np.abs(captured.frame(0.0).colour.astype(int) - frame.colour)  # two decoders of the same JPEG
    assert apart.mean() < 1.0 and np.percentile(apart, 99.9) <= 4


def test_calibrations_agree(playback: tuple[Capture, K4aCalibration], ours: tuple[CameraModel, Frame]) -> None:
    theirs, mine = model_of(playback[1], ours[0].serial), ours[0]
    for one, other in ((theirs.colour, mine.colour), (theirs.depth, mine.depth)):
        assert (one.width, one.height) == (other.width, other.height)
        assert np.allclose(one.K, other.K, atol=1e-3) and np.allclose(one.distortion, other.distortion, atol=1e-6)
    assert np.allclose(theirs.X_CD, mine.X_CD, atol=1e-7)


def test_pixels_go_from_depth_to_colour_as_the_library_takes_them(
    library: K4aLibrary, playback: tuple[Capture, K4aCalibration], ours: tuple[CameraModel, Frame]
) -> None:
    model, frame = ours
    pixels, _, valid = points_in_colour(frame.depth_mm, model)
    rows, columns = np.nonzero(valid)
    apart_px = []
    for i in np.random.default_rng(0).choice(len(rows), 2000, replace=False):
        v, u = int(rows[i]), int(columns[i])
        found, ok = Float2(), ctypes.c_int()
        library.k4a_calibration_2d_to_2d(
            ctypes.byref(playback[1]),
            ctypes.byref(Float2(u, v)),
            ctypes.c_float(float(frame.depth_mm[v, u])),
            0,
            1,
            ctypes.byref(found),
            ctypes.byref(ok),
        )
        if ok.value:
            apart_px.append(np.hypot(*(pixels[v, u] - [found.x, found.y])))
    assert len(apart_px) > 1500 and max(apart_px) < 0.01


def test_the_probe_loads_it_and_sees_that_no_camera_is_there_or_lists_it() -> None:
    report = probe_k4a()
    assert report.library == os.environ[NEEDED[0]] and report.maker is not None
    assert (report.error is None) == bool(report.serials)
