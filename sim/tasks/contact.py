"""Contact in the scenes of the tasks: one contact law, and its materials."""

from __future__ import annotations

import logging
from typing import Literal

from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    ProximityProperties,
)
from pydrake.multibody.plant import CoulombFriction, DiscreteContactApproximation, MultibodyPlant

RELAXATION_TIME_S = 0.020
HUNT_CROSSLEY_S_M = 1.0
"""Dissipation under "sap" and under "lagged", where a task says nothing else."""

logging.getLogger("drake").addFilter(lambda record: "half spaces" not in record.getMessage())
"""Drake warns of a half space that deformable bodies would not feel; there are none here."""


def set_contact(plant: MultibodyPlant, contact: Literal["sap", "lagged"]) -> None:
    """Choose the contact model of a plant."""
    plant.set_discrete_contact_approximation(
        DiscreteContactApproximation.kSap if contact == "sap" else DiscreteContactApproximation.kLagged
    )


def material(
    friction: float, stiffness_N_m: float | None = None, dissipation_s_m: float = HUNT_CROSSLEY_S_M
) -> ProximityProperties:
    """Friction and dissipation; a pair of two coefficients a and b has 2ab / (a + b), and the softer's dissipation."""
    properties = ProximityProperties()
    AddContactMaterial(dissipation_s_m, stiffness_N_m, CoulombFriction(friction, friction), properties)
    return properties


def relaxing(properties: ProximityProperties, relaxation_time_s: float) -> ProximityProperties:
    """With a relaxation time, which matters under "sap": a pair has the sum of its two, and one not set is 100 ms."""
    properties.AddProperty("material", "relaxation_time", relaxation_time_s)
    return properties


def rigid(friction: float) -> ProximityProperties:
    properties = material(friction)
    AddRigidHydroelasticProperties(1.0, properties)
    return properties


def compliant(
    friction: float,
    e_Pa: float,
    *,
    resolution_m: float = 0.01,
    dissipation_s_m: float = HUNT_CROSSLEY_S_M,
    relaxation_time_s: float = RELAXATION_TIME_S,
) -> ProximityProperties:
    """With the hydroelastic modulus `e_Pa`; `resolution_m` is the edge length of the mesh of a round shape."""
    properties = relaxing(material(friction, None, dissipation_s_m), relaxation_time_s)
    AddCompliantHydroelasticProperties(resolution_m, e_Pa, properties)
    return properties


def coefficient(pair: float, other: float) -> float:
    """The coefficient that makes a `pair` with `other`. Needs pair < 2 other: a pair never exceeds twice the lesser."""
    return pair * other / (2.0 * other - pair)
