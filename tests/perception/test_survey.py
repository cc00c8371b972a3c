"""A real mug, seen by a real camera that nobody calibrated to its table."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from kinect_recording import camera_model
from mug import Survey, find_plane, survey

from hw.types import CameraModel, Frame, Intrinsics
from perception.errors import ObjectNotFound, TableNotFound

DATA = Path(__file__).parent / "data"
UP = np.array([0.0, -1.0, 0.0])
LEFT, TOP = 90, 300  # of the cut in the whole depth image


def mug() -> tuple[Frame, CameraModel]:
    depth_mm = cv2.imread(str(DATA / "mug_depth.png"), cv2.IMREAD_UNCHANGED)
    full = camera_model((DATA / "kinect_calibration.json").read_bytes(), "720P", "NFOV_UNBINNED")
    K = full.depth.K.copy()
    K[:2, 2] -= [LEFT, TOP]
    depth = Intrinsics(depth_mm.shape[1], depth_mm.shape[0], K, full.depth.distortion)
    frame = Frame(0.0, np.zeros((720, 1280, 3), np.uint8), depth_mm)
    return frame, CameraModel("cut", full.colour, depth, full.X_CD)


def found(seed: int = 0) -> Survey:
    frame, model = mug()
    return survey(frame, model, UP, np.random.default_rng(seed))


def test_the_mug_is_a_cylinder_on_the_table() -> None:
    seen = found()
    circle = seen.cylinder.circle
    assert circle.radius_m == pytest.approx(0.0444, abs=0.001)
    assert circle.rms_m < 0.0018
    assert circle.share > 0.75  # the rest is its handle
    assert seen.cylinder.height_m == pytest.approx(0.113, abs=0.004)
    assert seen.table.rms_m < 0.0025
    assert np.rad2deg(np.arccos(seen.table.normal @ UP)) < 15


def test_another_draw_finds_the_same() -> None:
    one, other = found(0).cylinder.circle, found(7).cylinder.circle
    assert one.radius_m == pytest.approx(other.radius_m, abs=2e-4)


def test_no_table_and_no_cylinder_are_said() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(TableNotFound, match="no plane that faces up"):
        find_plane(rng.uniform(-3, 3, (5000, 3)), UP, rng)
    frame, model = mug()
    bare = frame.depth_mm.copy()
    bare[:185] = 0
    with pytest.raises(ObjectNotFound, match="is a cylinder"):
        survey(Frame(0.0, frame.colour, bare), model, UP, np.random.default_rng(0))
