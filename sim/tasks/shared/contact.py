"""Contact in the scenes of the tasks: one contact law, and its materials; and Drake's log and vectors."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import pydrake.common  # noqa: F401 - sets the level of its logger when it is first imported, so it comes first
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    ProximityProperties,
    SceneGraph,
)
from pydrake.multibody.plant import CoulombFriction, DiscreteContactApproximation, MultibodyPlant


def silence() -> None:
    """Let only Drake's errors through, in this process."""
    logging.getLogger("drake").setLevel(logging.ERROR)


silence()  # every scene uses this module; Drake warns that deformable bodies would not feel half spaces


def vector(x: float, y: float, z: float) -> Any:
    """(3,) for a Drake call. Typed `Any`, because no NumPy array matches the array type of Drake's stubs."""
    return np.array([x, y, z], dtype=np.float64)


RELAXATION_TIME_S = 0.120
HUNT_CROSSLEY_S_M = 1.0
"""Default dissipation under "sap" and under "lagged"."""


def set_contact(plant: MultibodyPlant, contact: Literal["sap", "lagged"]) -> None:
    """Choose the contact model of a plant."""
    plant.set_discrete_contact_approximation(
        DiscreteContactApproximation.kSap if contact == "sap" else DiscreteContactApproximation.kLagged
    )


def keep_apart(scene_graph: SceneGraph, pairs: Iterable[tuple[GeometryId, GeometryId]]) -> None:
    """Let the two bodies of each pair pass through each other. Call it before anything is built from `scene_graph`."""
    for one, other in pairs:
        apart = CollisionFilterDeclaration().ExcludeBetween(GeometrySet(one), GeometrySet(other))
        scene_graph.collision_filter_manager().Apply(apart)


def material(
    friction: float, stiffness_N_m: float | None = None, dissipation_s_m: float = HUNT_CROSSLEY_S_M
) -> ProximityProperties:
    """Friction and dissipation. A pair with coefficients a and b has the coefficient 2ab / (a + b), and the dissipation
    of the softer one.
    """
    properties = ProximityProperties()
    AddContactMaterial(dissipation_s_m, stiffness_N_m, CoulombFriction(friction, friction), properties)
    return properties


def relaxing(properties: ProximityProperties, relaxation_time_s: float) -> ProximityProperties:
    """Set a relaxation time, which matters under "sap". A pair has the sum of both times; a time that is not set is 100
    ms.
    """
    properties.AddProperty("material", "relaxation_time", relaxation_time_s)
    return properties


def rigid(friction: float) -> ProximityProperties:
    """A rigid material with relaxation time 0, so that a pair has the time of the other material."""
    properties = relaxing(material(friction), 0.0)
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
    """A compliant material with the hydroelastic modulus `e_Pa`; `resolution_m` is the mesh edge length of a round
    shape.
    """
    properties = relaxing(material(friction, None, dissipation_s_m), relaxation_time_s)
    AddCompliantHydroelasticProperties(resolution_m, e_Pa, properties)
    return properties


def coefficient(pair: float, other: float) -> float:
    """The coefficient that gives the `pair` coefficient with `other`.

    Needs pair < 2 other: a pair never exceeds twice the smaller one.
    """
    return pair * other / (2.0 * other - pair)
