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
from sim.tasks.pushing.mount import (
    BLOCK_M,
    GRIP_M,
    PLATE_HEIGHT_M,
    PLATE_THICKNESS_M,
    PLATE_WIDTH_M,
    ROOT_M,
    STEM_M,
    block_axes,
)
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
from sim.tasks.shared.drake import vector
from sim.tasks.shared.shapes import Shape, box, table_visual, turned_body
from sim.tasks.task import SceneBodies
from sim.types import Visual

_PRINT = (0.02, 0.05, 0.16)
_FELT = (0.03, 0.20, 0.07)
_BOTTLE = (0.70, 0.68, 0.62)
_FELT_M = 3e-4  # drawn this much above the table; in physics it is flush
_SIDES = 32


def patch_visual(x_m: tuple[float, float], y_m: tuple[float, float]) -> Visual:
    """The patch on the table, over the given ranges of x and y."""
    size, centre = np.array([x_m[1] - x_m[0], y_m[1] - y_m[0], _FELT_M]), np.array([sum(x_m), sum(y_m), _FELT_M]) / 2
    return Visual("world", *box(size, centre), _FELT)


def bottle_visual(body: str) -> Visual:
    """The bottle: its base, and above it the band."""
    half_m = BOTTLE_HEIGHT_M / 2
    seam_m = BASE_HEIGHT_M - half_m
    outline = np.array(
        [
            [BASE_RADIUS_M, -half_m],
            [BASE_RADIUS_M, seam_m],
            [BOTTLE_RADIUS_M, seam_m],
            [BOTTLE_RADIUS_M, half_m],
        ]
    )
    return Visual(body, *turned_body(outline, _SIDES), _BOTTLE)


def pusher_visuals(body: str) -> tuple[Visual, ...]:
    """Plate, stem and the block that the fingers hold, in the tool frame."""
    size_m = np.array([PLATE_THICKNESS_M, PLATE_WIDTH_M, PLATE_HEIGHT_M])
    plate = box(size_m, np.array([-PLATE_THICKNESS_M, 0.0, PLATE_HEIGHT_M]) / 2)
    along = (GRIP_M - ROOT_M) / np.linalg.norm(GRIP_M - ROOT_M)
    beside = np.cross([0.0, 0.0, 1.0], along) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], along))
    length_m = float(np.linalg.norm(GRIP_M - ROOT_M))
    stem = _turned(
        np.column_stack([along, beside, np.cross(along, beside)]),
        np.array([length_m, STEM_M, STEM_M]),
        (ROOT_M + GRIP_M) / 2,
    )
    block = _turned(block_axes(), np.array(BLOCK_M), GRIP_M)
    return tuple(Visual(body, *shape, _PRINT) for shape in (plate, stem, block))


def _turned(R: Array, size_m: Array, centre_m: Array) -> Shape:
    """A box along the axes that are the columns of `R` (3, 3)."""
    vertices_m, triangles = box(size_m, np.zeros(3))
    return vertices_m @ R.T + centre_m, triangles


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
