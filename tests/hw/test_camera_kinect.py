"""The factory calibration, and recordings made by the test itself."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import pytest
from kinect_files import CALIBRATION, SMALL, record
from kinect_recording import KinectRecording, camera_model, grey16

from hw.errors import CameraError, DeviceUnavailable


def test_calibration_of_a_real_device_in_720p() -> None:
    model = camera_model(CALIBRATION.read_bytes() + b"\0", "720P", "NFOV_UNBINNED")
    assert (model.colour.width, model.colour.height) == (1280, 720)
    assert (model.depth.width, model.depth.height) == (640, 576)
    # as libk4a gives them for this file
    assert model.colour.K[[0, 1, 0, 1], [0, 1, 2, 2]] == pytest.approx([611.795, 611.927, 639.304, 365.853], abs=1e-3)
    assert model.depth.K[[0, 1, 0, 1], [0, 1, 2, 2]] == pytest.approx([504.608, 504.733, 332.781, 348.830], abs=1e-3)
    assert model.depth.distortion[:4] == pytest.approx([0.54794, -0.02097, 2.056e-5, -7.210e-5], rel=1e-3)
    assert model.X_CD[:3, 3] == pytest.approx([-0.03208, -0.00221, 0.00388], abs=1e-5)
    assert np.rad2deg(np.arcsin(model.X_CD[1, 2])) == pytest.approx(4.94, abs=0.01)


def test_bytes_after_the_end_of_the_calibration_do_not_matter() -> None:
    """Orbbec's recordings have some."""
    plain = camera_model(CALIBRATION.read_bytes(), "720P", "NFOV_UNBINNED")
    more = camera_model(CALIBRATION.read_bytes() + b"\0\x7f\3leftover", "720P", "NFOV_UNBINNED")
    assert np.array_equal(plain.colour.K, more.colour.K)


@pytest.mark.parametrize("mode", ["YUY2_720P", "NV12_720P", "BGRA_1080P", "MJPG_1080P"])
def test_every_layout_of_pixels_is_read(tmp_path: Path, mode: str) -> None:
    record(tmp_path / "r.mkv", [0.0, 1 / 30], [0.0, 1 / 30], colour_mode=mode)
    with KinectRecording(tmp_path / "r.mkv") as recording:
        assert recording.model().colour.height == int(mode[5:-1])


def test_a_mode_is_a_part_of_one_reference_image() -> None:
    wide, narrow = (camera_model(CALIBRATION.read_bytes(), "2160P", m) for m in ("WFOV_UNBINNED", "NFOV_UNBINNED"))
    assert np.allclose(wide.depth.K[:2, 2] - narrow.depth.K[:2, 2], [192, 180])
    assert np.allclose(wide.colour.K[0, 0] / 3840, 611.79534912 / 1280)


def test_calibrations_that_cannot_be_used_are_refused() -> None:
    with pytest.raises(CameraError, match="mode 'VGA' is not known"):
        camera_model(CALIBRATION.read_bytes(), "VGA", "NFOV_UNBINNED")
    with pytest.raises(CameraError, match="read"):
        camera_model(b"{}", "720P", "NFOV_UNBINNED")
    unnamed = json.loads(CALIBRATION.read_bytes())
    unnamed["CalibrationInformation"]["Cameras"][0]["Purpose"] = True
    with pytest.raises(CameraError, match="factory calibration cannot be read"):
        camera_model(json.dumps(unnamed).encode(), "720P", "NFOV_UNBINNED")
    strange = json.loads(CALIBRATION.read_bytes())
    strange["CalibrationInformation"]["Cameras"][0]["Intrinsics"]["ModelType"] = "fisheye"
    with pytest.raises(CameraError, match="fisheye"):
        camera_model(json.dumps(strange).encode(), "720P", "NFOV_UNBINNED")
    bent = json.loads(CALIBRATION.read_bytes())
    bent["CalibrationInformation"]["Cameras"][1]["Rt"]["Rotation"][4] = 1e308
    with pytest.raises(CameraError, match="is no pose within one device"):
        camera_model(json.dumps(bent).encode(), "720P", "NFOV_UNBINNED")


def test_frames_are_paired_by_time_and_on_the_clock_of_the_device(tmp_path: Path) -> None:
    path = tmp_path / "r.mkv"
    record(path, [0.0, 1 / 30, 3 / 30], [0.0, 2 / 30, 3 / 30])
    with KinectRecording(path) as recording:
        model, frames = recording.model(), list(recording.frames())
        assert [f.t_s for f in recording.frames()] == [f.t_s for f in frames]  # can be read again
    assert model.serial == "001514394512"
    assert [f.t_s for f in frames] == pytest.approx([2.0, 2.1], abs=2e-3)
    assert [int(f.depth_mm[5, 0]) for f in frames] == [1000, 1002]
    assert [int(f.depth_mm[5, 9]) for f in frames] == [500, 500]
    assert [int(f.colour.mean().round()) for f in frames] == pytest.approx([0, 20], abs=2)
    assert frames[0].colour.shape == (*SMALL[::-1], 3) and frames[0].depth_mm.dtype == np.uint16


def test_infrared_comes_where_it_was_recorded_and_belongs_to_the_same_instant(tmp_path: Path) -> None:
    path = tmp_path / "r.mkv"
    instants_s = [0.0, 1 / 30, 2 / 30]
    record(path, instants_s, instants_s, infrared_s=[0.0, 2 / 30])
    with KinectRecording(path) as recording:
        frames = list(recording.frames())
    assert [f.t_s for f in frames] == pytest.approx([2.0, 2.067], abs=2e-3)
    dark = frames[1].infrared
    assert dark is not None and (int(dark[5, 0]), int(dark[5, 9])) == (1001, 500)
    record(path, instants_s, instants_s)
    with KinectRecording(path) as recording:
        assert [f.infrared for f in recording.frames()] == [None] * 3


@pytest.mark.parametrize("pixels", ["gray16be", "gray16le"])
def test_depth_is_read_in_either_order_of_bytes(pixels: str) -> None:
    depth_mm = np.arange(7 * 5, dtype=np.uint16).reshape(5, 7) * 1000  # 7 wide: rows are padded
    assert np.array_equal(grey16(av.VideoFrame.from_ndarray(depth_mm, format=pixels)), depth_mm)


def test_files_that_are_no_recordings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="opened"), KinectRecording(tmp_path / "none.mkv"):
        pass
    path = tmp_path / "r.mkv"
    record(path, [0.0], [0.0], titles=("COLOR", "THERMAL"))
    with KinectRecording(path) as recording, pytest.raises(CameraError, match="DEPTH"):
        recording.model()
    with pytest.raises(DeviceUnavailable, match="not open"):
        next(KinectRecording(path).frames())
