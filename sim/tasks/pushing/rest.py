"""The bottle's pose before the push, with the depth to which it sinks in under its own weight."""

from __future__ import annotations

import math

import numpy as np

from hw.types import Array
from sim.tasks.pushing.params import BOTTLE_HEIGHT_M, BOTTLE_MASS_KG, BOTTLE_RADIUS_M, START_M, Unmodelled

GRAVITY_M_S2 = 9.81


def rest_pose(context: Array, parameters: Array, nuisance: Array, unmodelled: Unmodelled | None) -> Array:
    """(4, 4) pose X_BO of the bottle ready for the push. The goal in `context` does not enter."""
    mass_kg = BOTTLE_MASS_KG * (1.0 if unmodelled is None else unmodelled.bottle_mass_scale)
    X_BO = np.eye(4)
    X_BO[:2, 3] = START_M + nuisance
    X_BO[2, 3] = BOTTLE_HEIGHT_M / 2 - sink_m(mass_kg, float(parameters[1]))
    return X_BO


def sink_m(mass_kg: float, e_Pa: float) -> float:
    """Depth d at which the pressure under the bottom carries the weight.

    Drake's field of a cylinder is e times the distance to the nearest surface over the radius R, so at depth d the
    force is pi e (R^3 - (R - d)^3) / (3 R). The formula ends at d = R, where the bottle is too soft to stand.
    """
    R = BOTTLE_RADIUS_M
    left = R**3 - 3.0 * R * mass_kg * GRAVITY_M_S2 / (math.pi * e_Pa)
    return R - float(np.cbrt(max(left, 0.0)))
