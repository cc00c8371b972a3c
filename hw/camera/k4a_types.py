"""Numbers and memory layouts of libk4a 1.4, as its header k4atypes.h declares them (little endian, 64 bit).

Orbbec's K4A-compatible library has the same ones.
"""

from __future__ import annotations

import ctypes
from typing import ClassVar

# k4a_result_t, k4a_buffer_result_t, k4a_wait_result_t
SUCCEEDED, FAILED = 0, 1
TOO_SMALL = 2
TIMEOUT = 2

# k4a_image_format_t
COLOR_MJPG, DEPTH16, IR16 = 0, 4, 5

COLOUR_RESOLUTIONS = {"720P": 1, "1080P": 2, "1440P": 3, "1536P": 4, "2160P": 5, "3072P": 6}
"""k4a_color_resolution_t, by the names of `hw.camera.kinect.COLOUR_MODES`."""
DEPTH_MODES = {"NFOV_2X2BINNED": 1, "NFOV_UNBINNED": 2, "WFOV_2X2BINNED": 3, "WFOV_UNBINNED": 4}
"""k4a_depth_mode_t, by the names of `hw.camera.kinect.DEPTH_MODES`."""
FPS_30 = 2

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


class Calibration(ctypes.Structure):
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
