"""The RealSense's driver over the SDK's own software device: lens, poses, units, pairing, choice, and what is told."""

from __future__ import annotations

from importlib import import_module

import cv2
import numpy as np
import pytest
from camera_stage import Shown
from staged_realsense import BENT, COLOUR_PX, DEPTH_PX, SoftRealSense, software_device

from hw.camera.k4a_device import ColourSettings
from hw.camera.probe import look_realsense
from hw.camera.realsense import MOST_OFF_PX, RealSenseDevice, lens
from hw.errors import CameraError, DeviceUnavailable

pytestmark = pytest.mark.extra


@pytest.fixture
def stage() -> SoftRealSense:
    return SoftRealSense()


def test_a_point_lands_where_the_makers_own_functions_put_it(stage: SoftRealSense) -> None:
    rs = import_module("pyrealsense2")
    driver = stage.driver(stage.clock.now_s)
    driver.open("S1")
    model = driver.model()
    colour, depth = (stage._profiles[kind] for kind in ("color", "depth"))
    assert list(colour.get_intrinsics().coeffs) == pytest.approx(BENT)
    for u, v, z_m in ((3.0, 4.0, 0.7), (30.0, 20.0, 1.1), (20.0, 33.0, 0.5)):
        p_D = rs.rs2_deproject_pixel_to_point(depth.get_intrinsics(), [u, v], z_m)
        p_C = np.array(rs.rs2_transform_point_to_point(depth.get_extrinsics_to(colour), p_D))
        np.testing.assert_allclose(model.X_CD @ [*p_D, 1.0], [*p_C, 1.0], atol=1e-6)
        K, bent = model.colour.K, model.colour.distortion
        (((a, b),),), _ = cv2.projectPoints(p_C[None, None], np.zeros(3), np.zeros(3), K, bent)
        ray = np.array(rs.rs2_deproject_pixel_to_point(colour.get_intrinsics(), [float(a), float(b)], 1.0))
        np.testing.assert_allclose(ray[:2] * 60.0, p_C[:2] / p_C[2] * 60.0, atol=2 * MOST_OFF_PX)


@pytest.mark.parametrize("bent", [[0.9, -2.0, 0.2, 0.1, 3.0], [0.4, -0.3, 0.02, 0.01, 0.0]])
def test_a_lens_that_cannot_be_expressed_is_refused(bent: list[float]) -> None:
    _, _, profiles = software_device(bent=bent)
    with pytest.raises(CameraError, match=r"is only known to .* px, limit 0\.05 px"):
        lens(profiles["color"].get_intrinsics(), "colour")


def test_everything_automatic_is_switched_off_and_read_back(stage: SoftRealSense) -> None:
    rs = import_module("pyrealsense2")
    driver = stage.driver(stage.clock.now_s)
    driver.open(None)
    asked = ColourSettings(exposure_us=12_340, white_balance_K=5000, gain=32, mains_hz=50)
    assert driver.set_colour(asked) == ColourSettings(12_300, 5000, 32, 50)
    colour = stage._sensors["color"]
    for option in (rs.option.enable_auto_exposure, rs.option.enable_auto_white_balance):
        assert colour.get_option(option) == 0
    with pytest.raises(CameraError, match="its white balance cannot be set to 9000"):
        driver.set_colour(ColourSettings(white_balance_K=9000))


def test_images_of_one_instant_come_together_in_millimetres(stage: SoftRealSense) -> None:
    driver = stage.driver(stage.clock.now_s)
    driver.open(None)
    driver.set_colour(ColourSettings())
    driver.start(infrared=True)
    stage._waiting.put(Shown(100.5, grey=50, depth_mm=812))
    found = driver.next_capture()
    assert found is not None and found.infrared is not None
    frame = found.frame(1.0)
    assert frame.colour.shape == (*COLOUR_PX[::-1], 3) and abs(int(frame.colour.mean()) - 50) <= 1
    assert frame.depth_mm.shape == DEPTH_PX[::-1] and (frame.depth_mm == 812).all()
    assert found.infrared.dtype == np.uint16 and (found.infrared == 99).all()
    assert found.device_s == pytest.approx(60.5)
    driver.close()


def test_colour_never_goes_with_the_depth_of_another_instant(stage: SoftRealSense) -> None:
    """An image that stays away leaves a gap: its partner is not kept for the next one."""
    driver = stage.driver(stage.clock.now_s)
    driver.open(None)
    driver.set_colour(ColourSettings())
    driver.start(infrared=False)
    stage._push("depth", np.full(DEPTH_PX[::-1], 500, np.uint16), 100.0)
    stage._waiting.put(Shown(100.0 + 1 / 30, depth_mm=700))
    found = driver.next_capture()
    assert found is not None and (found.depth_mm == 700).all()
    assert found.device_s == pytest.approx(60.0 + 1 / 30)
    driver.close()


def test_depth_in_finer_units_is_rounded_to_millimetres() -> None:
    stage = SoftRealSense(units_m=1e-4)
    driver = stage.driver(stage.clock.now_s)
    driver.open(None)
    driver.set_colour(ColourSettings())
    driver.start(infrared=False)
    stage._waiting.put(Shown(100.0, depth_mm=7006))
    found = driver.next_capture()
    assert found is not None and (found.depth_mm == 701).all()
    driver.close()


def test_the_camera_is_chosen_by_its_serial_number() -> None:
    cameras = [software_device(serial)[0] for serial in ("S1", "S2")]
    driver = RealSenseDevice(devices=lambda: cameras)
    with pytest.raises(DeviceUnavailable, match=r"several cameras are plugged in \(S1, S2\)"):
        driver.open(None)
    with pytest.raises(DeviceUnavailable, match="no RealSense with serial number S3; plugged in: S1, S2"):
        driver.open("S3")
    driver.open("S2")
    with pytest.raises(CameraError, match=r"no color images of \(1280, 720\) at 30 FPS, as over USB 2"):
        driver.model()
    with pytest.raises(DeviceUnavailable, match="no RealSense; plugged in: none"):
        RealSenseDevice(devices=tuple).open(None)


def test_the_doctor_is_told_serial_and_firmware_and_of_a_slow_port() -> None:
    rs = import_module("pyrealsense2")
    fast, slow = (software_device(serial)[0] for serial in ("S1", "S2"))
    slow.register_info(rs.camera_info.usb_type_descriptor, "2.1")
    report = look_realsense([fast, slow])
    assert (report.maker, report.serials, report.error) == ("Intel", ("S1",), None)
    assert report.devices[0].firmware == "5.16.0.1"
    assert look_realsense([slow]).error == "it is at a USB 2.1 port, which is too slow for colour and depth"
    assert look_realsense([]).error == "pyrealsense2 finds no camera"
