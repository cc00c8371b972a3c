"""The bottle's pose before the push, with the depth to which it sinks in under its own weight."""

from __future__ import annotations

import math

import numpy as np

from hw.types import Array
from sim.tasks.pushing.params import (
    BASE_E_PA,
    BASE_HEIGHT_M,
    BASE_RADIUS_M,
    BOTTLE_HEIGHT_M,
    BOTTLE_MASS_KG,
    START_M,
    Unmodelled,
)

GRAVITY_M_S2 = 9.81


def rest_pose(context: Array, parameters: Array, nuisance: Array, unmodelled: Unmodelled | None) -> Array:
    """(4, 4) pose X_BO of the bottle ready for the push. The goal in `context` does not enter."""
    mass_kg = BOTTLE_MASS_KG * (1.0 if unmodelled is None else unmodelled.bottle_mass_scale)
    X_BO = np.eye(4)
    X_BO[:2, 3] = START_M + nuisance
    X_BO[2, 3] = BOTTLE_HEIGHT_M / 2 - sink_m(mass_kg)
    return X_BO


def sink_m(mass_kg: float) -> float:
    """Depth d at which the pressure under the base carries the weight.

    Drake's field of a cylinder is its modulus times the distance to the nearest surface over the largest such distance
    within it, here half the base's height h. At a depth that is small against h the pressure is even but for the rim,
    so d = weight h / (2 pi e R^2).
    """
    return mass_kg * GRAVITY_M_S2 * BASE_HEIGHT_M / (2.0 * math.pi * BASE_E_PA * BASE_RADIUS_M**2)
