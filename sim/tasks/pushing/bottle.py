"""The bottle at rest: its place, its mass, and how deep it sinks into the table."""

from __future__ import annotations

import math

from hw.dynamics import GRAVITY_M_S2
from hw.poses import translation
from hw.types import Array
from sim.tasks.pushing.params import (
    BASE_E_PA,
    BASE_HEIGHT_M,
    BASE_RADIUS_M,
    BOTTLE_HEIGHT_M,
    BOTTLE_MASS_KG,
    START_M,
    PushingUnmodelled,
)
from sim.tasks.shared.shapes import TABLE_CORNERS_M


def on_table(xy_m: Array) -> bool:
    """Whether a point lies over the table."""
    (x0, y0), (x1, y1) = TABLE_CORNERS_M[:, :2]
    return bool(x0 <= xy_m[0] <= x1 and y0 <= xy_m[1] <= y1)


def bottle_mass_kg(parameters: Array, nuisance: Array, unmodelled: PushingUnmodelled) -> float:
    """The mass of every bottle of training."""
    return BOTTLE_MASS_KG


def rest_pose(context: Array, parameters: Array, nuisance: Array, unmodelled: PushingUnmodelled | None) -> Array:
    """(4, 4) pose X_BO of the bottle ready for the push. The goal in `context` does not enter."""
    mass_kg = BOTTLE_MASS_KG * (1.0 if unmodelled is None else unmodelled.bottle_mass_scale)
    return translation([*(START_M + nuisance), BOTTLE_HEIGHT_M / 2 - sink_m(mass_kg)])


def sink_m(mass_kg: float) -> float:
    """Depth d at which the pressure under the base carries the weight.

    Drake's field of a cylinder is its modulus times the distance to the nearest surface over the largest such distance
    within it, here half the base's height h. At a depth that is small against h the pressure is even but for the rim,
    so d = weight h / (2 pi e R^2).
    """
    return mass_kg * GRAVITY_M_S2 * BASE_HEIGHT_M / (2.0 * math.pi * BASE_E_PA * BASE_RADIUS_M**2)
