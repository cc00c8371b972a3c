"""The nominal camera calibration of a lab: the truth plus the world's error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hw.types import Array
from sim.lab.chance import calibration_stream
from sim.lab.kinect import default_X_BC
from sim.lab.world import Sensing, World


@dataclass(frozen=True, eq=False)
class NominalCalibration:
    """The fields of a `calib.types.HandEye`, because `sim` may not import `calib`."""

    X_BC: Array  # (4, 4)
    sigma_mm: float
    sigma_deg: float
    source: str
    created: str


def nominal_of(world: World, seed: int) -> NominalCalibration:
    """The nominal calibration of the lab of `world` and `seed`: with the world's error, and a true sigma."""
    return nominal_calibration(default_X_BC(), world.sensing, calibration_stream(seed))


def nominal_calibration(X_BC: Array, sensing: Sensing, rng: np.random.Generator) -> NominalCalibration:
    """`X_BC` (4, 4) shifted by `extrinsic_error_mm` and rotated about the camera's centre by `extrinsic_error_deg`.

    Both errors are normal in three directions, with these root mean squares, which are also the stated sigmas.
    """
    shift, turn = rng.standard_normal((2, 3)) / np.sqrt(3.0)
    error = np.eye(4)
    error[:3, :3] = Rotation.from_rotvec(np.deg2rad(sensing.extrinsic_error_deg) * turn).as_matrix()
    error[:3, 3] = 1e-3 * sensing.extrinsic_error_mm * shift
    return NominalCalibration(
        X_BC=X_BC @ error,
        sigma_mm=sensing.extrinsic_error_mm,
        sigma_deg=sensing.extrinsic_error_deg,
        source="nominal calibration of the simulated lab, with the world's extrinsic error",
        created="",
    )
