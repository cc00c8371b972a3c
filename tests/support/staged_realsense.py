"""A RealSense of the SDK's own making: its software device, whose sensors are handed images one by one.

The library is the real one: options, profiles, lens models, extrinsics, time stamps and queues are its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from camera_stage import Stage
from fake_k4a import BOOT_S

from hw.camera.grabber import Capture
from hw.camera.k4a_device import ColourSettings
from hw.camera.realsense import RealSenseDevice
from hw.types import CameraModel

COLOUR_PX, DEPTH_PX = (64, 48), (40, 36)
BASELINE_M = 0.015
TURN_RAD = 0.01
BENT = [0.06, -0.04, 0.002, -0.001, 0.01]
"""Distortion of the colour lens, in the SDK's inverse Brown-Conrady model."""


def software_device(serial: str = "S1", *, bent: Sequence[float] = BENT, units_m: float = 0.001) -> Any:
    """A device with colour, depth and infrared; returns it with its sensors and profiles by stream."""
    rs = import_module("pyrealsense2")
    device = rs.software_device()
    info = rs.camera_info
    for key, value in ((info.serial_number, serial), (info.firmware_version, "5.16.0.1"), (info.name, "software")):
        device.register_info(key, value)
    depth, colour = device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")
    depth.add_read_only_option(rs.option.depth_units, units_m)
    option = rs.option
    for which, low, high, usual in (
        (option.enable_auto_exposure, 0, 1, 1), (option.enable_auto_white_balance, 0, 1, 1),
        (option.power_line_frequency, 0, 3, 3), (option.exposure, 1, 10000, 156),
        (option.white_balance, 2800, 6500, 4600), (option.gain, 0, 128, 64),
    ):  # fmt: skip
        range_ = rs.option_range()
        range_.min, range_.max, range_.step, range_.default = low, high, 1, usual
        colour.add_option(which, range_, True)
    none, forms, streams = [0.0] * 5, rs.format, rs.stream
    made = {
        "depth": _stream(depth, streams.depth, forms.z16, DEPTH_PX, 2, 1, rs.distortion.brown_conrady, none),
        "infrared": _stream(depth, streams.infrared, forms.y8, DEPTH_PX, 1, 2, rs.distortion.brown_conrady, none),
        "color": _stream(colour, streams.color, forms.bgr8, COLOUR_PX, 3, 3, rs.distortion.inverse_brown_conrady, bent),
    }
    moved = rs.extrinsics()
    c, s = np.cos(TURN_RAD), np.sin(TURN_RAD)
    moved.rotation = [c, s, 0, -s, c, 0, 0, 0, 1]  # column by column: a turn by +TURN_RAD about Z
    moved.translation = [BASELINE_M, 0, 0]
    made["depth"].register_extrinsics_to(made["color"], moved)
    return device, {"depth": depth, "infrared": depth, "color": colour}, made


def _stream(
    sensor: Any, kind: Any, form: Any, size: tuple[int, int], bpp: int, uid: int, model: Any, bent: Sequence[float]
) -> Any:
    rs = import_module("pyrealsense2")
    stream, lens = rs.video_stream(), rs.intrinsics()
    lens.width, lens.height = size
    lens.ppx, lens.ppy, lens.fx, lens.fy = size[0] / 2 - 0.3, size[1] / 2 + 0.2, 60.0, 61.0
    lens.model, lens.coeffs = model, list(bent)
    stream.type, stream.uid, stream.fmt, stream.fps, stream.bpp = kind, uid, form, 30, bpp
    stream.width, stream.height, stream.intrinsics = *size, lens
    return sensor.add_video_stream(stream).as_video_stream_profile()


class SoftRealSense(Stage):
    """The stage: hands what is shown to the SDK when the camera's thread asks for its next capture."""

    def __init__(self, *, units_m: float = 0.001) -> None:
        super().__init__()
        self._units_m = units_m
        self.handles: dict[int, Any] = {}
        self.open: set[int] = set()
        self.made, self._sensors, self._profiles = software_device(units_m=units_m)
        self._number = 0

    def driver(self, now_s: Callable[[], float]) -> _Fed:
        """The device's driver, fed by this stage."""
        return _Fed(self, RealSenseDevice(now_s, lambda: (self.made,), COLOUR_PX, DEPTH_PX))

    def feed(self) -> bool:
        """Push the next images that are shown into the SDK; False at a timeout."""
        if isinstance(shown := self.next_shown(), str):
            return False
        width, height = COLOUR_PX
        self._push("color", np.full((height, width, 3), shown.grey, np.uint8), shown.t_s)
        width, height = DEPTH_PX
        self._push("depth", np.full((height, width), shown.depth_mm, np.uint16), shown.t_s + 0.004)
        if "infrared" in self.wanted:
            self._push("infrared", np.full((height, width), 99, np.uint8), shown.t_s + 0.004)
        return True

    wanted: tuple[str, ...] = ("color", "depth")

    def _push(self, kind: str, pixels: Any, t_s: float) -> None:
        rs = import_module("pyrealsense2")
        frame = rs.software_video_frame()
        self._number += 1
        frame.pixels, frame.bpp, frame.stride = pixels, pixels.strides[1], pixels.strides[0]
        frame.timestamp, frame.domain = 1e3 * (t_s - BOOT_S), rs.timestamp_domain.hardware_clock
        frame.frame_number, frame.profile = self._number, self._profiles[kind]
        frame.depth_units = self._units_m
        self._sensors[kind].on_video_frame(frame)


class _Fed:
    """`hw.camera.k4a.Device`: the driver, with the stage feeding the SDK before each capture."""

    def __init__(self, stage: SoftRealSense, driver: RealSenseDevice) -> None:
        self._stage, self._driver, self.modes = stage, driver, driver.modes

    def open(self, serial: str | None) -> None:
        self._driver.open(serial)

    def model(self) -> CameraModel:
        return self._driver.model()

    def set_colour(self, wanted: ColourSettings) -> ColourSettings:
        return self._driver.set_colour(wanted)

    def start(self, *, infrared: bool) -> None:
        self._stage.wanted = ("color", "depth", "infrared") if infrared else ("color", "depth")
        self._driver.start(infrared=infrared)

    def next_capture(self) -> Capture | None:
        return self._driver.next_capture() if self._stage.feed() else None

    def close(self) -> None:
        self._driver.close()
