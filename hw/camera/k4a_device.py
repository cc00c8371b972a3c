"""One open device of libk4a: its calibration, its settings, its captures, copied out of the library's memory.

Every failure names what to do.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.camera import k4a_library as k4a
from hw.camera.grabber import Capture
from hw.camera.k4a_library import DebugHandler, K4aLibrary, serial_of
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Intrinsics

RATE_HZ = 30.0
_WAIT_MS = 500
_LATE_S = 1.0  # an arrival stamp further from now comes from another clock
_MAINS = {50: 1, 60: 2}  # Hz -> value of libk4a's control


@dataclass(frozen=True)
class ColourSettings:
    """Settings of the colour camera. The device keeps them until it loses power."""

    exposure_us: int = 8000  # the device rounds up to its next step: 8330 in 60 Hz mode, 10000 in 50 Hz mode
    white_balance_K: int = 4500  # a multiple of 10
    gain: int | None = None  # 0 to 255; None: unchanged
    mains_hz: int = 60  # of the lamps; decides which exposure steps do not flicker

    def __post_init__(self) -> None:
        if not 500 <= self.exposure_us <= 33330:
            raise ValueError(f"exposure {self.exposure_us} us lies outside of 500 to 33330 us, the range at 30 FPS")
        if not 2500 <= self.white_balance_K <= 12500 or self.white_balance_K % 10:
            raise ValueError(f"white balance {self.white_balance_K} K: it must be a multiple of 10 from 2500 to 12500")
        if self.gain is not None and not 0 <= self.gain <= 255:
            raise ValueError(f"gain {self.gain} lies outside of 0 to 255")
        if self.mains_hz not in _MAINS:
            raise ValueError(f"mains {self.mains_hz} Hz: it must be 50 or 60")


class K4aDevice:
    """`hw.camera.served.Device`. Not thread-safe, except that `next_capture` may run in a thread of its own."""

    modes = ("720P", "NFOV_UNBINNED")

    def __init__(self, library: K4aLibrary, now_s: Callable[[], float] = time.monotonic) -> None:
        self._library, self._now_s = library, now_s
        self._device: ctypes.c_void_p | None = None
        self._running = False
        self._said = ""
        self._handler = DebugHandler(self._hear)  # the library keeps its address, so it must live as long
        self.serial = ""
        self.infrared = False

    def open(self, serial: str | None) -> None:
        """The camera with this serial number, or the only one. Raises DeviceUnavailable."""
        library = self._library
        library.k4a_set_debug_message_handler(self._handler, None, k4a.LOG_ERROR)
        serials = []
        for index in range(library.k4a_device_get_installed_count()):
            device = ctypes.c_void_p()
            if library.k4a_device_open(index, ctypes.byref(device)) != k4a.SUCCEEDED:
                serials.append("one that cannot be opened (another program uses it, or permission is missing)")
                continue
            name = serial_of(library, device)
            serials.append(name)
            if serial in (None, name) and self._device is None:
                self._device, self.serial = device, name
            else:
                library.k4a_device_close(device)
        if self._device is None or (serial is None and len(serials) > 1):
            self.close()
            raise DeviceUnavailable(_not_there(serial, serials))

    def close(self) -> None:
        """Stop and close; safe to call again."""
        self.stop()
        if self._device is not None:
            self._library.k4a_device_close(self._device)
            self._device = None
        self._library.k4a_set_debug_message_handler(DebugHandler(), None, k4a.LOG_ERROR)

    def model(self) -> CameraModel:
        """The factory calibration, for the modes in use. Raises CameraError."""
        raw = k4a.K4aCalibration()
        colour, depth = k4a.COLOUR_720P, k4a.NFOV_UNBINNED
        self._need(
            self._library.k4a_device_get_calibration(self._handle, depth, colour, ctypes.byref(raw)),
            "its factory calibration cannot be read",
        )
        return model_of(raw, self.serial)

    def set_colour(self, settings: ColourSettings) -> ColourSettings:
        """Fix exposure, white balance and gain; return the values that the device then reports. Raises CameraError."""
        self._set(k4a.POWERLINE_FREQUENCY, _MAINS[settings.mains_hz], "mains frequency")
        self._set(k4a.EXPOSURE_TIME_ABSOLUTE, settings.exposure_us, "exposure")
        self._set(k4a.WHITEBALANCE, settings.white_balance_K, "white balance")
        if settings.gain is not None:
            self._set(k4a.GAIN, settings.gain, "gain")
        mains = {value: hz for hz, value in _MAINS.items()}[self._get(k4a.POWERLINE_FREQUENCY, "mains frequency")]
        return ColourSettings(
            exposure_us=self._get(k4a.EXPOSURE_TIME_ABSOLUTE, "exposure"),
            white_balance_K=self._get(k4a.WHITEBALANCE, "white balance"),
            gain=self._get(k4a.GAIN, "gain"),
            mains_hz=mains,
        )

    def start(self, *, infrared: bool) -> None:
        """Colour and depth at 30 FPS, exposed together. Raises CameraError."""
        self.infrared = infrared
        configuration = k4a.DeviceConfiguration(
            color_format=k4a.COLOR_MJPG,
            color_resolution=k4a.COLOUR_720P,
            depth_mode=k4a.NFOV_UNBINNED,
            camera_fps=k4a.FPS_30,
            synchronized_images_only=True,
        )
        self._need(
            self._library.k4a_device_start_cameras(self._handle, ctypes.byref(configuration)),
            "it does not start to send images (without a display the depth engine fails: docs/guide/cameras.md)",
        )
        self._running = True

    def stop(self) -> None:
        """Stop the images; does nothing if none run."""
        if self._running and self._device is not None:
            self._library.k4a_device_stop_cameras(self._device)
        self._running = False

    def next_capture(self) -> Capture | None:
        """The next capture with all images; None if none came within half a second, or an image is missing.

        Raises CameraError when the camera is gone.
        """
        capture = ctypes.c_void_p()
        result = self._library.k4a_device_get_capture(self._handle, ctypes.byref(capture), _WAIT_MS)
        if result == k4a.TIMEOUT:
            self._said = ""
            return None
        self._need(result, "it stopped answering: it was unplugged, or its USB port is overloaded")
        try:
            return read_capture(self._library, capture, self._now_s(), infrared=self.infrared)
        finally:
            self._library.k4a_capture_release(capture)

    @property
    def _handle(self) -> ctypes.c_void_p:
        if self._device is None:
            raise DeviceUnavailable("the camera is not open: use it inside a `with` block")
        return self._device

    def _set(self, command: int, value: int, what: str) -> None:
        result = self._library.k4a_device_set_color_control(self._handle, command, k4a.MODE_MANUAL, value)
        self._need(result, f"its {what} cannot be set to {value}")

    def _get(self, command: int, what: str) -> int:
        mode, value = ctypes.c_int(), ctypes.c_int32()
        result = self._library.k4a_device_get_color_control(
            self._handle, command, ctypes.byref(mode), ctypes.byref(value)
        )
        self._need(result, f"its {what} cannot be read")
        if mode.value != k4a.MODE_MANUAL:
            raise CameraError(
                f"camera {self.serial}: its {what} stayed automatic; unplug it for ten seconds and run the command "
                "again"
            )
        return value.value

    def _need(self, result: int, problem: str) -> None:
        why, self._said = f" (libk4a: {self._said})" if self._said else "", ""
        if result != k4a.SUCCEEDED:
            raise CameraError(
                f"camera {self.serial}: {problem}{why}. Plug it into a USB 3 port of its own, wait for its light, and "
                "run the command again; for more see docs/guide/cameras.md"
            )

    def _hear(self, _context: int, _level: int, file: bytes, line: int, message: bytes) -> None:
        """Keep the first error of a call: it is the cause, and later ones echo it through the library."""
        self._said = self._said or message.decode("utf-8", "replace").strip()


def read_capture(library: K4aLibrary, capture: ctypes.c_void_p, now_s: float, *, infrared: bool) -> Capture | None:
    """Copy a capture; None if colour or depth is missing, or if infrared is wanted and missing.

    `now_s` is the host's monotonic time. It replaces the library's arrival stamp if that is missing or comes from
    another clock (recordings, Orbbec's library). Raises CameraError on a format that was not asked for.
    """
    with (
        _image(library, library.k4a_capture_get_color_image, capture) as colour,
        _image(library, library.k4a_capture_get_depth_image, capture) as depth,
        _image(library, library.k4a_capture_get_ir_image, capture) as dark,
    ):
        if colour is None or depth is None or (infrared and dark is None):
            return None
        if (kind := library.k4a_image_get_format(colour)) != k4a.COLOR_MJPG:
            raise CameraError(
                f"the camera sends colour in format {kind} instead of MJPG ({k4a.COLOR_MJPG}): unplug it, plug it in "
                "again and run the command again"
            )
        device_s = 1e-6 * library.k4a_image_get_device_timestamp_usec(colour)
        stamped_s = 1e-9 * library.k4a_image_get_system_timestamp_nsec(colour)
        return Capture(
            device_s=device_s,
            arrived_s=stamped_s if 0.0 <= now_s - stamped_s <= _LATE_S else now_s,
            jpeg=_content(library, colour),
            depth_mm=_grey(library, depth, k4a.DEPTH16),
            infrared=_grey(library, dark, k4a.IR16) if infrared else None,
            exposure_us=int(library.k4a_image_get_exposure_usec(colour)),
            white_balance_K=int(library.k4a_image_get_white_balance(colour)),
        )


@contextmanager
def _image(
    library: K4aLibrary, get: Callable[[ctypes.c_void_p], int | None], capture: ctypes.c_void_p
) -> Iterator[ctypes.c_void_p | None]:
    address = get(capture)
    if not address:
        yield None
        return
    image = ctypes.c_void_p(address)
    try:
        yield image
    finally:
        library.k4a_image_release(image)


def _content(library: K4aLibrary, image: ctypes.c_void_p) -> bytes:
    return ctypes.string_at(library.k4a_image_get_buffer(image), library.k4a_image_get_size(image))


def _grey(library: K4aLibrary, image: Any, kind: int) -> NDArray[np.uint16]:
    if (sent := library.k4a_image_get_format(image)) != kind:
        raise CameraError(
            f"the camera sends an image of format {sent} instead of {kind}, 16-bit grey: unplug it, plug it in again "
            "and run the command again"
        )
    width, height = library.k4a_image_get_width_pixels(image), library.k4a_image_get_height_pixels(image)
    stride = library.k4a_image_get_stride_bytes(image)
    content = _content(library, image)
    if stride < 2 * width or len(content) < stride * height:
        raise CameraError(
            f"a depth image of {width} x {height} has only {len(content)} bytes: check the camera's USB cable"
        )
    rows = np.frombuffer(content, "<u2", count=stride * height // 2).reshape(height, -1)
    return np.ascontiguousarray(rows[:, :width], dtype=np.uint16)


def model_of(raw: k4a.K4aCalibration, serial: str) -> CameraModel:
    """libk4a's calibration as a `CameraModel`. Raises CameraError on an unknown lens model."""
    X_CD = np.eye(4)
    pose = raw.extrinsics[k4a.TYPE_DEPTH][k4a.TYPE_COLOUR]
    X_CD[:3, :3] = np.reshape(pose.rotation, (3, 3))
    X_CD[:3, 3] = 1e-3 * np.array(pose.translation)
    colour, depth = raw.color_camera_calibration, raw.depth_camera_calibration
    return CameraModel(serial, _intrinsics(colour, "colour"), _intrinsics(depth, "depth"), X_CD)


def _intrinsics(camera: k4a.CalibrationCamera, what: str) -> Intrinsics:
    if camera.intrinsics.type not in (k4a.BROWN_CONRADY, k4a.RATIONAL_6KT):
        raise CameraError(
            f"the {what} camera has lens model {camera.intrinsics.type}, and only Brown-Conrady is supported: use an "
            "Azure Kinect or a Femto Bolt"
        )
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1, _ = camera.intrinsics.parameters
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    distortion = np.array([k1, k2, p1, p2, k3, k4, k5, k6])
    return Intrinsics(camera.resolution_width, camera.resolution_height, K, distortion)


def _not_there(serial: str | None, serials: list[str]) -> str:
    listing = ", ".join(serials) or "none"
    if serial is None and len(serials) > 1:
        return f"several cameras are plugged in ({listing}): name the serial number of the one to use"
    problem = f"no camera with serial number {serial}" if serial else "no usable camera"
    return f"{problem}; plugged in: {listing}. Check cable, power supply and USB 3 port, and see docs/guide/cameras.md"
