"""An Intel RealSense of the D400 family through its maker's `pyrealsense2` (`pip install adaptsim[realsense]`).

The sensors are read one by one, without the SDK's pipeline: each frame keeps the stamp of the device's own clock, and
colour goes with the depth image exposed nearest to it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import cv2
import numpy as np

from hw.camera.grabber import Capture
from hw.camera.k4a_device import RATE_HZ, ColourSettings
from hw.errors import CameraError, DeviceUnavailable
from hw.extras import install_line
from hw.types import Array, CameraModel, Intrinsics

COLOUR_PX, DEPTH_PX = (1280, 720), (848, 480)
INSTALL = install_line("realsense")
MOST_OFF_PX = 0.05
"""The largest error of the lens in `hw.types.Intrinsics` against the maker's own lens model."""
_WAIT_MS = 500
_EXPOSURE_US = 100
"""Unit of the colour camera's exposure."""
_MAINS = {50: 1, 60: 2}  # Hz -> value of the SDK's option
_QUALITY = 95  # of the JPEG that is kept until nothing moves


def plugged_in() -> Sequence[Any]:
    """The SDK's devices. Raises DeviceUnavailable without the SDK."""
    return tuple(_sdk().context().query_devices())


class RealSenseDevice:
    """`hw.camera.served.Device`. Opens on `open`; `next_capture` may run in a thread of its own."""

    modes = (f"{COLOUR_PX[0]}x{COLOUR_PX[1]}", f"{DEPTH_PX[0]}x{DEPTH_PX[1]}")

    def __init__(
        self,
        now_s: Callable[[], float] = time.monotonic,
        devices: Callable[[], Sequence[Any]] = plugged_in,
        colour_px: tuple[int, int] = COLOUR_PX,
        depth_px: tuple[int, int] = DEPTH_PX,
    ) -> None:
        self._now_s, self._devices = now_s, devices
        self._sizes = {"color": colour_px, "depth": depth_px, "infrared": depth_px}
        self._device: Any = None
        self._sensors: tuple[Any, ...] = ()  # asked for once: the SDK makes new objects each time
        self._running: list[Any] = []
        self._queue: Any = None
        self._newest: dict[str, tuple[float, Any]] = {}  # stream -> device's stamp in s, pixels
        self._wanted: tuple[str, ...] = ()
        self._exposure_us = self._white_balance_K = 0
        self.serial = ""

    def open(self, serial: str | None) -> None:
        """The camera with this serial number, or the only one. Raises DeviceUnavailable."""
        rs = _sdk()
        devices = {device.get_info(rs.camera_info.serial_number): device for device in self._devices()}
        if serial is None and len(devices) > 1:
            raise DeviceUnavailable(
                f"several cameras are plugged in ({', '.join(devices)}): name the serial number of the one to use"
            )
        self.serial = serial or next(iter(devices), "")
        if self.serial not in devices:
            problem = f"no RealSense with serial number {serial}" if serial else "no RealSense"
            raise DeviceUnavailable(
                f"{problem}; plugged in: {', '.join(devices) or 'none'}. Check its cable and that the port is USB 3"
            )
        self._device = devices[self.serial]
        self._sensors = tuple(self._device.query_sensors())

    def close(self) -> None:
        """Stop and close; safe to call again."""
        for sensor in self._running:
            sensor.stop()
            sensor.close()
        self._running, self._sensors, self._device, self._newest = [], (), None, {}

    def model(self) -> CameraModel:
        """The factory calibration, for the modes in use. Raises CameraError."""
        colour, depth = (self._profile(kind)[1] for kind in ("color", "depth"))
        moved = depth.get_extrinsics_to(colour)
        X_CD = np.eye(4)
        X_CD[:3, :3] = np.reshape(moved.rotation, (3, 3)).T  # the SDK's is column by column
        X_CD[:3, 3] = moved.translation
        return CameraModel(
            self.serial, lens(colour.get_intrinsics(), "colour"), lens(depth.get_intrinsics(), "depth"), X_CD
        )

    def set_colour(self, settings: ColourSettings) -> ColourSettings:
        """Fix exposure, white balance and gain; return the values that the device then reports. Raises CameraError."""
        option, sensor = _sdk().option, self._profile("color")[0]
        self._set(sensor, option.enable_auto_exposure, 0, "exposure")
        self._set(sensor, option.enable_auto_white_balance, 0, "white balance")
        self._set(sensor, option.power_line_frequency, _MAINS[settings.mains_hz], "mains frequency")
        self._exposure_us = _EXPOSURE_US * self._set(
            sensor, option.exposure, round(settings.exposure_us / _EXPOSURE_US), "exposure"
        )
        self._white_balance_K = self._set(sensor, option.white_balance, settings.white_balance_K, "white balance")
        gain = int(sensor.get_option(option.gain)) if settings.gain is None else settings.gain
        gain = self._set(sensor, option.gain, gain, "gain")
        return ColourSettings(self._exposure_us, self._white_balance_K, gain, settings.mains_hz)

    def start(self, *, infrared: bool) -> None:
        """Colour and depth at 30 FPS. Raises CameraError."""
        rs = _sdk()
        self._wanted = ("color", "depth", "infrared") if infrared else ("color", "depth")
        self._queue = rs.frame_queue(4 * len(self._wanted))
        opened = [self._profile(kind) for kind in self._wanted]
        for sensor in {id(sensor): sensor for sensor, _ in opened}.values():
            if sensor.supports(rs.option.global_time_enabled):
                sensor.set_option(rs.option.global_time_enabled, 0)  # it would bend the device's clock
            try:
                sensor.open([profile for of, profile in opened if of is sensor])
                sensor.start(self._queue)
            except RuntimeError as error:
                raise self._wrong(f"it does not start to send images ({error})") from error
            self._running.append(sensor)

    def next_capture(self) -> Capture | None:
        """The next images that belong together; None if none came within half a second."""
        while True:
            came, frame = self._queue.try_wait_for_frame(_WAIT_MS)
            if not came:
                return None
            arrived_s, kind = self._now_s(), frame.profile.stream_type().name
            pixels = np.array(frame.get_data())
            if kind == "depth":
                pixels = _in_mm(pixels, 1e3 * frame.as_depth_frame().get_units())
            self._newest[kind] = _stamp_s(frame), pixels
            stamps_s = [self._newest[kind][0] for kind in self._wanted if kind in self._newest]
            if len(stamps_s) == len(self._wanted) and max(stamps_s) - min(stamps_s) <= 0.5 / RATE_HZ:
                return self._captured(arrived_s)

    def _captured(self, arrived_s: float) -> Capture:
        frames, self._newest = self._newest, {}
        device_s, colour = frames["color"]
        return Capture(
            device_s=device_s,
            arrived_s=arrived_s,
            jpeg=cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes(),
            depth_mm=frames["depth"][1],
            infrared=frames["infrared"][1].astype(np.uint16) if "infrared" in self._wanted else None,
            exposure_us=self._exposure_us,
            white_balance_K=self._white_balance_K,
        )

    def _profile(self, kind: str) -> tuple[Any, Any]:
        """(sensor, profile) of a stream in the mode in use. Raises CameraError, DeviceUnavailable."""
        if self._device is None:
            raise DeviceUnavailable("the camera is not open: use it inside a `with` block")
        rs = _sdk()
        stream = getattr(rs.stream, kind)
        form = {"color": rs.format.bgr8, "depth": rs.format.z16, "infrared": rs.format.y8}[kind]
        for sensor in self._sensors:
            for profile in sensor.get_stream_profiles():
                if (profile.stream_type(), profile.format(), profile.fps()) == (stream, form, RATE_HZ):
                    video = profile.as_video_stream_profile()
                    if (video.width(), video.height()) == self._sizes[kind] and profile.stream_index() <= 1:
                        return sensor, video
        raise self._wrong(f"it has no {kind} images of {self._sizes[kind]} at {RATE_HZ:g} FPS, as over USB 2")

    def _set(self, sensor: Any, option: Any, value: int, what: str) -> int:
        try:
            sensor.set_option(option, value)
            return int(sensor.get_option(option))
        except RuntimeError as error:
            raise self._wrong(f"its {what} cannot be set to {value} ({error})") from error

    def _wrong(self, problem: str) -> CameraError:
        return CameraError(
            f"camera {self.serial}: {problem}. Plug it into a USB 3 port of its own and run the command again; for "
            "more see docs/guide/cameras.md"
        )


def lens(sdk_lens: Any, what: str) -> Intrinsics:
    """The SDK's intrinsics as OpenCV's, fitted to its own lens model over the picture. Raises CameraError."""
    rs = _sdk()
    u, v = np.meshgrid(np.linspace(0, sdk_lens.width - 1, 17), np.linspace(0, sdk_lens.height - 1, 13))
    rays = np.array(
        [rs.rs2_deproject_pixel_to_point(sdk_lens, [a, b], 1.0) for a, b in zip(u.flat, v.flat, strict=True)]
    )
    off_px = float("inf")
    if np.isfinite(rays).all():
        fitted_lens = _fitted(sdk_lens, u.ravel(), v.ravel(), rays)
        off_px = float(np.abs(_projected(fitted_lens, rays) - np.stack([u.ravel(), v.ravel()], axis=1)).max())
    if not off_px <= MOST_OFF_PX:
        raise CameraError(
            f"the {what} camera's lens ({sdk_lens.model}) is only known to {off_px:.2f} px, limit {MOST_OFF_PX:g} px: "
            "reset it to the factory calibration with the maker's tools"
        )
    return fitted_lens


def _fitted(sdk_lens: Any, u: Array, v: Array, rays: Array) -> Intrinsics:
    """The distortion that bends `rays` (N, 3) at depth 1 into the pixels `u`, `v` (N,): linear least squares."""
    K = np.array([[sdk_lens.fx, 0, sdk_lens.ppx], [0, sdk_lens.fy, sdk_lens.ppy], [0, 0, 1]])
    x, y = rays[:, :2].T
    r2 = x**2 + y**2
    bent = np.concatenate([(u - sdk_lens.ppx) / sdk_lens.fx - x, (v - sdk_lens.ppy) / sdk_lens.fy - y])
    columns = [np.concatenate([axis * r2**power for axis in (x, y)]) for power in (1, 2, 3)]
    columns += [np.concatenate([2 * x * y, r2 + 2 * y**2]), np.concatenate([r2 + 2 * x**2, 2 * x * y])]
    (k1, k2, k3, p1, p2), *_ = np.linalg.lstsq(np.stack(columns, axis=1), bent, rcond=None)
    return Intrinsics(sdk_lens.width, sdk_lens.height, K, np.array([k1, k2, p1, p2, k3, 0, 0, 0]))


def _projected(intrinsics: Intrinsics, rays: Array) -> Array:
    pixels, _ = cv2.projectPoints(rays[:, None, :], np.zeros(3), np.zeros(3), intrinsics.K, intrinsics.distortion)
    return np.asarray(pixels[:, 0, :])


def _stamp_s(frame: Any) -> float:
    """The middle of the exposure by the device's clock, if the driver passes it on; else the frame's own stamp."""
    middle = _sdk().frame_metadata_value.sensor_timestamp
    if frame.supports_frame_metadata(middle):
        return 1e-6 * float(frame.get_frame_metadata(middle))
    return 1e-3 * float(frame.get_timestamp())


def _in_mm(depth: Any, units_mm: float) -> Any:
    """Depth in whole mm; by default the camera's unit is 1 mm."""
    if abs(units_mm - 1.0) < 1e-6:
        return depth
    return np.round(depth * units_mm).clip(0, 65535).astype(np.uint16)


def _sdk() -> Any:
    try:
        return import_module("pyrealsense2")
    except ImportError as error:
        raise DeviceUnavailable(f"pyrealsense2, the SDK of RealSense cameras, is not installed: {INSTALL}") from error
