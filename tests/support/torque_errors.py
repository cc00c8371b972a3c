"""The errors of a live estimate of external torques, which simulated arms report."""

from __future__ import annotations

import numpy as np

from hw.types import Array, frozen_array

TORQUE_NOISE_NM = frozen_array((0.22, 0.32, 0.19, 0.31, 0.09, 0.11, 0.03), (7,), "torque noise")
"""(7,) root mean square of the high-pass filtered joint torques of a real Panda in motion."""
RIPPLE_NM, RIPPLE_PER_RAD = 0.15, 30.0
"""Error of the torque estimate that is periodic in each joint's angle (gears)."""


def estimate_errors_Nm(q_rad: Array, rng: np.random.Generator) -> Array:
    """(..., 7) a live estimate at joints (..., 7) without any contact: the noise of a real Panda, and ripple that
    depends on the posture.
    """
    ripple_Nm = RIPPLE_NM * np.sin(RIPPLE_PER_RAD * np.asarray(q_rad) + np.arange(7.0))
    return np.asarray(ripple_Nm + TORQUE_NOISE_NM * rng.standard_normal(np.shape(q_rad)))
