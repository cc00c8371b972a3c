"""libk4a through ctypes: its place, its numbers and memory layouts, and the prototypes of the functions in use.

Numbers and layouts are those of libk4a 1.4's header k4atypes.h (little endian, 64 bit). Orbbec's K4A-compatible
library has the same ones.

Loading or calling a vendor's library may end the process: `hw.camera.probe` does it in a child first.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
from collections.abc import Mapping
from ctypes import POINTER, c_char_p, c_int, c_int32, c_size_t, c_uint32, c_uint64, c_void_p
from pathlib import Path
from typing import Any, ClassVar, Protocol, cast

from hw.errors import DeviceUnavailable

# k4a_result_t, k4a_buffer_result_t, k4a_wait_result_t
SUCCEEDED, FAILED = 0, 1
TOO_SMALL = 2
TIMEOUT = 2

# k4a_image_format_t
COLOR_MJPG, DEPTH16, IR16 = 0, 4, 5

# k4a_color_resolution_t, k4a_depth_mode_t and k4a_fps_t
COLOUR_720P, NFOV_UNBINNED, FPS_30 = 1, 2, 2

# k4a_color_control_command_t and k4a_color_control_mode_t
EXPOSURE_TIME_ABSOLUTE, WHITEBALANCE, GAIN, POWERLINE_FREQUENCY = 0, 6, 8, 9
MODE_AUTO, MODE_MANUAL = 0, 1

# k4a_calibration_type_t
TYPE_DEPTH, TYPE_COLOUR, TYPES = 0, 1, 4

# k4a_calibration_model_type_t
RATIONAL_6KT, BROWN_CONRADY = 3, 4

LOG_ERROR = 1


class DeviceConfiguration(ctypes.Structure):
    """k4a_device_configuration_t."""

    _fields_: ClassVar = [
        ("color_format", ctypes.c_int),
        ("color_resolution", ctypes.c_int),
        ("depth_mode", ctypes.c_int),
        ("camera_fps", ctypes.c_int),
        ("synchronized_images_only", ctypes.c_bool),
        ("depth_delay_off_color_usec", ctypes.c_int32),
        ("wired_sync_mode", ctypes.c_int),
        ("subordinate_delay_off_master_usec", ctypes.c_uint32),
        ("disable_streaming_indicator", ctypes.c_bool),
    ]


class Extrinsics(ctypes.Structure):
    """k4a_calibration_extrinsics_t: row-major rotation, translation in mm."""

    _fields_: ClassVar = [("rotation", ctypes.c_float * 9), ("translation", ctypes.c_float * 3)]


class IntrinsicParameters(ctypes.Structure):
    """k4a_calibration_intrinsics_t: cx cy fx fy k1 k2 k3 k4 k5 k6 codx cody p2 p1 metric_radius."""

    _fields_: ClassVar = [
        ("type", ctypes.c_int),
        ("parameter_count", ctypes.c_uint),
        ("parameters", ctypes.c_float * 15),
    ]


class CalibrationCamera(ctypes.Structure):
    """k4a_calibration_camera_t."""

    _fields_: ClassVar = [
        ("extrinsics", Extrinsics),
        ("intrinsics", IntrinsicParameters),
        ("resolution_width", ctypes.c_int),
        ("resolution_height", ctypes.c_int),
        ("metric_radius", ctypes.c_float),
    ]


class K4aCalibration(ctypes.Structure):
    """k4a_calibration_t; `extrinsics[source][target]` takes points of the source into the target."""

    _fields_: ClassVar = [
        ("depth_camera_calibration", CalibrationCamera),
        ("color_camera_calibration", CalibrationCamera),
        ("extrinsics", Extrinsics * TYPES * TYPES),
        ("depth_mode", ctypes.c_int),
        ("color_resolution", ctypes.c_int),
    ]


class Version(ctypes.Structure):
    """k4a_version_t."""

    _fields_: ClassVar = [("major", ctypes.c_uint32), ("minor", ctypes.c_uint32), ("iteration", ctypes.c_uint32)]

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.iteration}"


class HardwareVersion(ctypes.Structure):
    """k4a_hardware_version_t: firmware of the device."""

    _fields_: ClassVar = [
        ("rgb", Version),
        ("depth", Version),
        ("audio", Version),
        ("depth_sensor", Version),
        ("firmware_build", ctypes.c_int),
        ("firmware_signature", ctypes.c_int),
    ]


ENVIRONMENT = "ADAPTSIM_K4A_LIBRARY"
"""Environment variable that names the library file, if the loader does not find the right one by itself."""
_NAMES = ("libk4a.so.1.4", "libk4a.so.2.0", "libk4a.so")
_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/local/lib",
    "/usr/lib",
    "/opt/OrbbecSDK_K4A_Wrapper/lib",
)
INSTALL = (
    "install the manufacturer's library, for the Azure Kinect `sudo apt-get install libk4a1.4` from "
    "packages.microsoft.com, "
    "for the Femto Bolt Orbbec's OrbbecSDK-K4A-Wrapper, and name its file in ADAPTSIM_K4A_LIBRARY if the loader does "
    "not find it; docs/guide/cameras.md has the lines"
)

_Handle, _HandleOut = c_void_p, POINTER(c_void_p)
DebugHandler = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_int, c_char_p)
"""k4a_logging_message_cb_t: (context, level, file, line, message)."""

PROTOTYPES: Mapping[str, tuple[Any, tuple[Any, ...]]] = {
    "k4a_set_debug_message_handler": (c_int, (DebugHandler, c_void_p, c_int)),
    "k4a_device_get_installed_count": (c_uint32, ()),
    "k4a_device_open": (c_int, (c_uint32, _HandleOut)),
    "k4a_device_close": (None, (_Handle,)),
    "k4a_device_get_serialnum": (c_int, (_Handle, c_void_p, POINTER(c_size_t))),
    "k4a_device_get_version": (c_int, (_Handle, POINTER(HardwareVersion))),
    "k4a_device_get_calibration": (c_int, (_Handle, c_int, c_int, POINTER(K4aCalibration))),
    "k4a_device_get_color_control": (c_int, (_Handle, c_int, POINTER(c_int), POINTER(c_int32))),
    "k4a_device_set_color_control": (c_int, (_Handle, c_int, c_int, c_int32)),
    "k4a_device_start_cameras": (c_int, (_Handle, POINTER(DeviceConfiguration))),
    "k4a_device_stop_cameras": (None, (_Handle,)),
    "k4a_device_get_capture": (c_int, (_Handle, _HandleOut, c_int32)),
    "k4a_capture_release": (None, (_Handle,)),
    "k4a_capture_get_color_image": (c_void_p, (_Handle,)),
    "k4a_capture_get_depth_image": (c_void_p, (_Handle,)),
    "k4a_capture_get_ir_image": (c_void_p, (_Handle,)),
    "k4a_image_get_buffer": (c_void_p, (_Handle,)),
    "k4a_image_get_size": (c_size_t, (_Handle,)),
    "k4a_image_get_format": (c_int, (_Handle,)),
    "k4a_image_get_width_pixels": (c_int, (_Handle,)),
    "k4a_image_get_height_pixels": (c_int, (_Handle,)),
    "k4a_image_get_stride_bytes": (c_int, (_Handle,)),
    "k4a_image_get_device_timestamp_usec": (c_uint64, (_Handle,)),
    "k4a_image_get_system_timestamp_nsec": (c_uint64, (_Handle,)),
    "k4a_image_get_exposure_usec": (c_uint64, (_Handle,)),
    "k4a_image_get_white_balance": (c_uint32, (_Handle,)),
    "k4a_image_release": (None, (_Handle,)),
}
"""Name -> (result, arguments), as in k4a.h 1.4."""


class K4aLibrary(Protocol):
    """A library with the functions of `PROTOTYPES`: the maker's, or one that a test builds from C callbacks."""

    def __getattr__(self, name: str) -> Any: ...


def library_file() -> str | None:
    """The file to load, which the environment names or which lies in the usual folders; None if it is not found."""
    if named := os.environ.get(ENVIRONMENT):
        return named
    for folder in _FOLDERS:
        for name in _NAMES:
            if (Path(folder) / name).exists():
                return str(Path(folder) / name)
    return ctypes.util.find_library("k4a")


def load(file: str) -> K4aLibrary:
    """Load and declare every function. Raises DeviceUnavailable naming what is missing; `probe` adds what to do."""
    try:
        library = ctypes.CDLL(file)
    except OSError as error:
        raise DeviceUnavailable(f"{file} cannot be loaded: {error}") from error
    for name, (result, arguments) in PROTOTYPES.items():
        try:
            function = getattr(library, name)
        except AttributeError as error:
            raise DeviceUnavailable(f"{file} has no function {name}, so it is not libk4a 1.4") from error
        function.restype, function.argtypes = result, arguments
    return cast(K4aLibrary, library)


def serial_of(library: K4aLibrary, device: c_void_p) -> str:
    """Serial number of an open device, "" if it reports none."""
    size = c_size_t(0)
    library.k4a_device_get_serialnum(device, None, ctypes.byref(size))
    text = ctypes.create_string_buffer(max(size.value, 1))
    if library.k4a_device_get_serialnum(device, text, ctypes.byref(size)) != 0:
        return ""
    return text.value.decode("ascii", "replace")
