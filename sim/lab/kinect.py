"""The Kinect of the simulated lab: factory calibration and pose."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from hw.poses import pose
from hw.types import Array, CameraModel, Intrinsics
from perception.geometry import scaled

EXPOSURE_S = 0.008
"""Exposure of the colour camera in a well-lit room."""

_COLOUR = Intrinsics(
    1280,
    720,
    np.array([[611.8, 0, 639.3], [0, 611.9, 365.9], [0, 0, 1]]),
    np.array([0.33012, -2.48940, -0.00016, -0.00013, 1.45367, 0.20891, -2.30292, 1.37513]),
)
_DEPTH = Intrinsics(
    640,
    576,
    np.array([[504.6, 0, 332.8], [0, 504.7, 348.8], [0, 0, 1]]),
    np.array([0.54794, -0.02097, 0.00002, -0.00007, -0.00265, 0.88968, 0.08613, -0.01391]),
)
"""The rounded factory figures of one Azure Kinect, with 720p colour and unbinned depth in the narrow field of view."""

_DEPTH_TILT_RAD = 0.0863  # about the X axis, of one device; 6 degrees by design
_DEPTH_OFFSET_M = (-0.0321, -0.0022, 0.0039)


def kinect_model(size: Literal["kinect", "small"] = "kinect") -> CameraModel:
    """Factory calibration of the lab's camera; "small" is the same view with a quarter of the pixels per side."""
    c, s = np.cos(_DEPTH_TILT_RAD), np.sin(_DEPTH_TILT_RAD)
    X_CD = pose([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]], _DEPTH_OFFSET_M)
    if size == "kinect":
        return CameraModel("simulated-kinect", _COLOUR, _DEPTH, X_CD)
    return CameraModel("simulated-kinect-small", scaled(_COLOUR, 0.25), scaled(_DEPTH, 0.25), X_CD)


def default_X_BC() -> Array:
    """(4, 4) the colour camera opposite the arm, 0.9 m from the work area, looking down at it by 53°."""
    eye_m = np.array([1.28, 0.0, 0.72])
    return looking(eye_m, np.array([0.74, 0.0, 0.0]) - eye_m)


def looking(eye_m: Array, ahead: Array) -> Array:
    """(4, 4) an upright camera (X right, Y down, Z forward) at `eye_m` (3,) that looks along `ahead` (3,)."""
    z = ahead / np.linalg.norm(ahead)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return pose(np.stack([x, np.cross(z, x), z], axis=1), eye_m)


def moved_X_BC(moved_mm: float, moved_deg: float, rng: np.random.Generator) -> Array:
    """`default_X_BC` after somebody moved the camera by the stated amounts, in directions drawn from `rng`."""
    along, about = (axis / np.linalg.norm(axis) for axis in rng.standard_normal((2, 3)))
    R = Rotation.from_rotvec(np.deg2rad(moved_deg) * about).as_matrix()
    return np.asarray(default_X_BC() @ pose(R, 1e-3 * moved_mm * along))
