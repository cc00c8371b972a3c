"""Table, patch, bottle and pusher in a Drake plant: the same physics whether an arm carries the pusher or not.

The bottle is compliant hydroelastic: a band with the modulus e that the plate meets, and a hard base that stands on the
table. Everything else is rigid. Each of its three pairs has its
own friction: Drake combines two coefficients harmonically. So the bottle has `BOTTLE_COEFFICIENT`, and table, patch and
plate have the coefficients that give the right pair. The plate stays clear of the table.
"""

from __future__ import annotations

import math

import numpy as np
from pydrake.geometry import Box, Cylinder
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    PrismaticJoint,
    PrismaticSpring,
    RigidBody,
    SpatialInertia,
    UnitInertia,
    WeldJoint,
)

from hw.types import Array
from sim.tasks.pushing import table
from sim.tasks.pushing.looks import bottle_visual, patch_visual, pusher_visuals
from sim.tasks.pushing.mount import PLATE_HEIGHT_M, PLATE_THICKNESS_M, PLATE_WIDTH_M
from sim.tasks.pushing.params import (
    BASE_E_PA,
    BASE_HEIGHT_M,
    BASE_RADIUS_M,
    BOTTLE_HEIGHT_M,
    BOTTLE_MASS_KG,
    BOTTLE_RADIUS_M,
    PATCH_SIZE_M,
    PATCH_X_M,
    PLATE_FRICTION,
    Unmodelled,
)
from sim.tasks.shared.contact import coefficient, compliant, rigid, set_contact
from sim.tasks.shared.drake_types import vector
from sim.tasks.shared.shapes import table_visual
from sim.tasks.task import SceneBodies

TOOL = "pusher"
OBJECT = "bottle"
STEP_S = 0.0025
MESH_M = 0.0125
"""Edge length of the meshes of base and band: sixteen sides around."""
DISSIPATION_S_M = 10.0
"""Hunt-Crossley: a bottle hit at 0.6 m/s hardly bounces (docs/decisions/0008)."""

RELAXATION_S = 0.020
"""Dissipation in a world with contact = "sap"."""

BOTTLE_COEFFICIENT = 1.0
PLATE_MASS_KG = 0.1
GRAVITY_M_S2 = 9.81

SLOSH_RAD_S = math.sqrt(1.841 * GRAVITY_M_S2 / BOTTLE_RADIUS_M)
"""First sideways mode of a liquid in a cylinder, as deep as wide (1.841: first root of J1')."""
SLOSH_DAMPING_RATIO = 0.05
SLOSH_LIMIT_M = 0.02


def time_step_s(unmodelled: Unmodelled | None) -> float:
    """The time step of the plant for `build_scene`, s."""
    return STEP_S if unmodelled is None or unmodelled.dt_s is None else unmodelled.dt_s


def build_scene(
    plant: MultibodyPlant,
    tool_parent: Frame,
    X_PT: Array,
    parameters: Array,
    nuisance: Array,
    unmodelled: Unmodelled | None,
) -> SceneBodies:
    """Add table, bottle and pusher, and set contact model and gravity. The pusher's body frame is T (see mount.py).

    Raises OutOfRange if the patch leaves the table.
    """
    effects = unmodelled or Unmodelled()
    mu, e_Pa, mu_p, y_p_m = map(float, parameters)
    set_contact(plant, effects.contact)
    roll, pitch = effects.table_tilt_rad
    down = np.array([math.sin(pitch), -math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch)])
    plant.mutable_gravity_field().set_gravity_vector(GRAVITY_M_S2 * down)
    half_m = PATCH_SIZE_M * effects.patch_size_scale / 2
    area = (PATCH_X_M - half_m, PATCH_X_M + half_m), (y_p_m - half_m, y_p_m + half_m)
    for name, sheet, friction in (("table", table.table_around(*area), mu), ("patch", table.patch(*area), mu_p)):
        properties = rigid(coefficient(friction, BOTTLE_COEFFICIENT))
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), sheet, name, properties)
    _add_bottle(plant, e_Pa, effects)
    _add_pusher(plant, tool_parent, X_PT)
    visuals = (table_visual(), patch_visual(*area), bottle_visual(OBJECT), *pusher_visuals(TOOL))
    return SceneBodies(tool=TOOL, object=OBJECT, visuals=visuals)


def _add_bottle(plant: MultibodyPlant, e_Pa: float, effects: Unmodelled) -> None:
    instance = plant.AddModelInstance(OBJECT)
    mass_kg = BOTTLE_MASS_KG * effects.bottle_mass_scale
    solid_kg = mass_kg * (1.0 - effects.slosh_share)
    central = UnitInertia.SolidCylinder(BOTTLE_RADIUS_M, BOTTLE_HEIGHT_M, vector(0.0, 0.0, 1.0)) * solid_kg
    p_OC_m = vector(0.0, 0.0, effects.com_height_m - BOTTLE_HEIGHT_M / 2)
    body = plant.AddRigidBody(OBJECT, instance, SpatialInertia.MakeFromCentralInertia(solid_kg, p_OC_m, central))
    for name, radius_m, (low_m, high_m), modulus_Pa in (
        ("base", BASE_RADIUS_M, (0.0, BASE_HEIGHT_M), BASE_E_PA),
        ("band", BOTTLE_RADIUS_M, (BASE_HEIGHT_M, BOTTLE_HEIGHT_M), e_Pa),
    ):
        middle = RigidTransform(vector(0.0, 0.0, (low_m + high_m - BOTTLE_HEIGHT_M) / 2))
        properties = compliant(
            BOTTLE_COEFFICIENT,
            modulus_Pa,
            resolution_m=MESH_M,
            dissipation_s_m=DISSIPATION_S_M / effects.plate_restitution_scale,
            relaxation_time_s=RELAXATION_S / effects.plate_restitution_scale,
        )
        plant.RegisterCollisionGeometry(body, middle, Cylinder(radius_m, high_m - low_m), name, properties)
    if effects.slosh_share > 0.0:
        _add_slosh(plant, body, mass_kg * effects.slosh_share, effects.slosh_height_m)


def _add_slosh(plant: MultibodyPlant, bottle: RigidBody, mass_kg: float, height_m: float) -> None:
    """Add a mass that slides across the bottle on two damped springs, like the liquid's first mode."""
    instance = bottle.model_instance()
    at = RigidTransform(vector(0.0, 0.0, height_m - BOTTLE_HEIGHT_M / 2))
    frame = plant.AddFrame(FixedOffsetFrame("slosh_centre", bottle.body_frame(), at))
    point = SpatialInertia(mass_kg, vector(0.0, 0.0, 0.0), UnitInertia.SolidSphere(BOTTLE_RADIUS_M / 2))
    for name, axis, inertia in (
        ("slosh_x", vector(1.0, 0.0, 0.0), SpatialInertia.Zero()),
        ("slosh_y", vector(0.0, 1.0, 0.0), point),
    ):
        moving = plant.AddRigidBody(name, instance, inertia)
        damping_Ns_m = 2.0 * SLOSH_DAMPING_RATIO * SLOSH_RAD_S * mass_kg
        joint = PrismaticJoint(name, frame, moving.body_frame(), axis, -SLOSH_LIMIT_M, SLOSH_LIMIT_M, damping_Ns_m)
        plant.AddForceElement(PrismaticSpring(plant.AddJoint(joint), 0.0, mass_kg * SLOSH_RAD_S**2))
        frame = moving.body_frame()


def _add_pusher(plant: MultibodyPlant, parent: Frame, X_PT: Array) -> None:
    instance = plant.AddModelInstance(TOOL)
    size_m = (PLATE_THICKNESS_M, PLATE_WIDTH_M, PLATE_HEIGHT_M)
    centre = RigidTransform(vector(-PLATE_THICKNESS_M / 2, 0.0, PLATE_HEIGHT_M / 2))
    inertia = SpatialInertia.SolidBoxWithMass(PLATE_MASS_KG, *size_m).Shift(
        vector(PLATE_THICKNESS_M / 2, 0.0, -PLATE_HEIGHT_M / 2)
    )
    pusher: RigidBody = plant.AddRigidBody(TOOL, instance, inertia)
    plant.set_gravity_enabled(instance, False)
    plant.AddJoint(WeldJoint(TOOL + "_mount", parent, pusher.body_frame(), RigidTransform(X_PT)))
    properties = rigid(coefficient(PLATE_FRICTION, BOTTLE_COEFFICIENT))
    plant.RegisterCollisionGeometry(pusher, centre, Box(*size_m), "plate", properties)
