"""Colour and depth of a real mug, through the factory calibration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from kinect_alignment import align, points_in_colour, undistorted
from kinect_recording import camera_model
from scipy.spatial.transform import Rotation

from hw.errors import CameraError
from hw.types import CameraModel, Frame

HERE = Path(__file__).parent
CALIBRATION = HERE.parent / "perception" / "data" / "kinect_calibration.json"


@pytest.fixture(scope="module")
def model() -> CameraModel:
    return camera_model(CALIBRATION.read_bytes(), "720P", "NFOV_UNBINNED")


@pytest.fixture(scope="module")
def mug() -> Frame:
    colour, depth_mm = np.zeros((720, 1280, 3), np.uint8), np.zeros((576, 640), np.uint16)
    colour[360:680, 240:600] = cv2.imread(str(HERE / "data" / "mug_colour.jpg"))[..., ::-1]
    depth_mm[300:570, 90:430] = cv2.imread(str(HERE / "data" / "mug_depth.png"), cv2.IMREAD_UNCHANGED)
    return Frame(0.8, colour, depth_mm)


def turned(model: CameraModel, angle_deg: float) -> CameraModel:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, np.deg2rad(angle_deg), 0.0]).as_matrix()
    return replace(model, X_CD=X @ model.X_CD)


def test_the_outlines_of_the_mug_lie_on_its_edges(mug: Frame, model: CameraModel) -> None:
    found = align(mug, model, 0.2, 0.5)
    assert len(found.beside_px) > 180
    assert found.median_px <= 0.75 and abs(found.shift_px) < 0.5 and abs(found.growth_px) < 0.5


@pytest.mark.parametrize("angle_deg", [-0.2, 0.2, 0.4])
def test_a_depth_camera_turned_by_hand_is_noticed(mug: Frame, model: CameraModel, angle_deg: float) -> None:
    by_px = np.deg2rad(angle_deg) * model.colour.K[0, 0]
    found = align(mug, turned(model, angle_deg), 0.2, 0.5)
    assert found.median_px >= 1.5
    assert -found.shift_px / by_px == pytest.approx(0.8, abs=0.4)


def test_nothing_near_is_said_so(mug: Frame, model: CameraModel) -> None:
    with pytest.raises(CameraError, match=r"only 0 clear points on outlines between 0.01 and 0.02 m"):
        align(mug, model, 0.01, 0.02)


def test_undistortion_and_projection_undo_each_other(model: CameraModel) -> None:
    """Over all of the narrow field of view: a plane at 1 m, seen by both, comes back to where it was."""
    pixels = np.stack(np.meshgrid(np.arange(30.0, 611, 20), np.arange(30.0, 547, 20)), axis=-1).reshape(-1, 2)
    rays = undistorted(pixels, model.depth)
    back, _ = cv2.projectPoints(
        np.column_stack([rays, np.ones(len(rays))]), np.zeros(3), np.zeros(3), model.depth.K, model.depth.distortion
    )
    assert np.abs(back.reshape(-1, 2) - pixels).max() < 1e-4
    away = np.linalg.norm(rays * np.diag(model.depth.K)[:2] + model.depth.K[:2, 2] - pixels, axis=1)
    assert away.max() > 5.0  # the lens bends by that much: leaving it out would be seen


def test_pixels_as_the_makers_library_gives_them(model: CameraModel) -> None:
    """k4a_calibration_2d_to_2d of libk4a 1.4.2 for these pixels and depths of the same device."""
    depth_mm = np.zeros((576, 640), np.uint16)
    known = KNOWN_FROM_LIBK4A
    for u, v, z_mm, _, _ in known:
        depth_mm[v, u] = z_mm
    pixels, _, valid = points_in_colour(depth_mm, model)
    assert valid.sum() == len(known)
    for u, v, _, colour_u, colour_v in known:
        assert pixels[v, u] == pytest.approx([colour_u, colour_v], abs=2e-3)


KNOWN_FROM_LIBK4A = (  # u, v, mm; u, v in the colour image
    (120, 320, 250, 281.9850, 376.3830),
    (320, 288, 1000, 604.0897, 343.6088),
    (500, 150, 700, 830.4103, 155.7418),
    (200, 480, 600, 428.8666, 592.1027),
    (560, 400, 1500, 932.9324, 487.9308),
)
