"""The factory calibration of an Azure Kinect, read from the device's JSON for one mode of its cameras.

The file gives lengths as shares of a reference image; each mode is a part of it. The tables below are those of the
maker's SDK.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.bounded import parse_table
from hw.errors import CameraError
from hw.types import Array, CameraModel, Intrinsics

_MODELS = ("CALIBRATION_LensDistortionModelBrownConrady", "CALIBRATION_LensDistortionModel6KT")


@dataclass(frozen=True)
class Mode:
    """The part of the reference image that a mode keeps."""

    reference: tuple[int, int]  # width, height
    offset: tuple[int, int]
    size: tuple[int, int]


COLOUR_MODES: Mapping[str, Mode] = {
    "720P": Mode((1280, 960), (0, 120), (1280, 720)),
    "1080P": Mode((1920, 1440), (0, 180), (1920, 1080)),
    "1440P": Mode((2560, 1920), (0, 240), (2560, 1440)),
    "1536P": Mode((2048, 1536), (0, 0), (2048, 1536)),
    "2160P": Mode((3840, 2880), (0, 360), (3840, 2160)),
    "3072P": Mode((4096, 3072), (0, 0), (4096, 3072)),
}
DEPTH_MODES: Mapping[str, Mode] = {
    "NFOV_2X2BINNED": Mode((512, 512), (96, 90), (320, 288)),
    "NFOV_UNBINNED": Mode((1024, 1024), (192, 180), (640, 576)),
    "WFOV_2X2BINNED": Mode((512, 512), (0, 0), (512, 512)),
    "WFOV_UNBINNED": Mode((1024, 1024), (0, 0), (1024, 1024)),
}


def camera_model(calibration: bytes, colour_mode: str, depth_mode: str) -> CameraModel:
    """The camera model from the device's JSON; the modes are keys of the tables above.

    Raises CameraError naming the missing or unknown field.
    """
    try:
        content = parse_table(calibration.rstrip(b"\0"), is_toml=False)["CalibrationInformation"]
        cameras = {camera["Purpose"].removeprefix("CALIBRATION_CameraPurpose"): camera for camera in content["Cameras"]}
        colour, depth = cameras["PhotoVideo"], cameras["Depth"]
        return CameraModel(
            serial=str(content["Metadata"]["SerialId"]),
            colour=_intrinsics(colour, _mode(COLOUR_MODES, colour_mode)),
            depth=_intrinsics(depth, _mode(DEPTH_MODES, depth_mode)),
            X_CD=_pose(colour) @ np.linalg.inv(_pose(depth)),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise CameraError(f"the camera's factory calibration cannot be read: {error!r}; record again") from error


def _mode(modes: Mapping[str, Mode], name: str) -> Mode:
    if name not in modes:
        raise CameraError(f"camera mode {name!r} is not known: choose one of {', '.join(modes)}")
    return modes[name]


def _intrinsics(camera: dict[str, Any], mode: Mode) -> Intrinsics:
    if camera["Intrinsics"]["ModelType"] not in _MODELS:
        raise ValueError(f"lens model {camera['Intrinsics']['ModelType']}")
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = camera["Intrinsics"]["ModelParameters"]
    width, height = mode.reference
    # in the file, pixel centres lie at + 0.5
    K = [[fx * width, 0, cx * width - mode.offset[0] - 0.5], [0, fy * height, cy * height - mode.offset[1] - 0.5]]
    return Intrinsics(*mode.size, np.array([*K, [0, 0, 1]]), np.array([k1, k2, p1, p2, k3, k4, k5, k6]))


def _pose(camera: dict[str, Any]) -> Array:
    """(4, 4) of the reference in this camera."""
    X = np.eye(4)
    X[:3, :3] = np.reshape(camera["Rt"]["Rotation"], (3, 3))
    X[:3, 3] = camera["Rt"]["Translation"]
    return X
