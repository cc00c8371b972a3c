"""Table, patch, bottle and pusher in a Drake plant: the same physics whether an arm carries the pusher or not.

The bottle is compliant hydroelastic: a band with the modulus e that the plate meets, and a hard base that stands on the
table. Everything else is rigid. Each of its three pairs has its own friction: Drake combines two coefficients
harmonically. So the bottle has `BOTTLE_COEFFICIENT`, and table, patch and plate have the coefficients that give the
right pair. The plate stays clear of the table.

Table and patch are two flush rigid surfaces, each an open sheet of triangles at z = 0. A bottle across the seam has one
contact surface with each, over the part of its bottom that lies there, and the seam has no wall to run into. Every
sheet has one unused vertex far below it, so that its hull has a volume.
"""

from __future__ import annotations

import math

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Box, Cylinder, InMemoryMesh, Mesh
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

from hw.dynamics import GRAVITY_M_S2
from hw.types import Array
from sim.errors import OutOfRange
from sim.tasks.hardware import SceneBodies
from sim.tasks.pushing.bottle import on_table
from sim.tasks.pushing.mount import PLATE_CENTRE_M, PLATE_M, PLATE_MASS_KG, pusher_visuals
from sim.tasks.pushing.params import (
    BASE_E_PA,
    BASE_HEIGHT_M,
    BASE_RADIUS_M,
    BOTTLE_HEIGHT_M,
    BOTTLE_MASS_KG,
    BOTTLE_RADIUS_M,
    PARAMETERS,
    PATCH_SIZE_M,
    PATCH_X_M,
    PLATE_FRICTION,
    PushingUnmodelled,
)
from sim.tasks.shared.contact import coefficient, compliant, rigid, set_contact, vector
from sim.tasks.shared.gravity import gravity_m_s2
from sim.tasks.shared.shapes import TABLE_CORNERS_M, box, obj_text, table_visual, turned_body
from sim.types import Visual

_FAR_BELOW_M = -1.0


def _table_around(x_m: tuple[float, float], y_m: tuple[float, float]) -> Mesh:
    """The table without the rectangle. Raises OutOfRange if it does not lie within the table."""
    outer, inner = _corners(*TABLE_CORNERS_M[:, :2].T), _corners(x_m, y_m)
    if not (on_table(inner[0]) and on_table(inner[2])):
        raise OutOfRange(
            f"the patch, x {x_m[0]:.3f} to {x_m[1]:.3f} m, y {y_m[0]:.3f} to {y_m[1]:.3f} m, leaves the table: move "
            "the bottle away from the edge"
        )
    sides = [(i, (i + 1) % 4) for i in range(4)]
    return _sheet(np.concatenate([outer, inner]), [t for i, j in sides for t in ((i, j, 4 + j), (i, 4 + j, 4 + i))])


def _corners(x_m: Array | tuple[float, float], y_m: Array | tuple[float, float]) -> Array:
    """(4, 3) counter-clockwise from above."""
    (x0, x1), (y0, y1) = x_m, y_m
    return np.array([(x0, y0, 0.0), (x1, y0, 0.0), (x1, y1, 0.0), (x0, y1, 0.0)])


def _sheet(points_m: Array, triangles: list[tuple[int, int, int]]) -> Mesh:
    text = obj_text(np.vstack([points_m, [*points_m[0, :2], _FAR_BELOW_M]]), np.array(triangles))
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".obj", "sheet.obj")), 1.0)


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


TOOL = "pusher"
OBJECT = "bottle"
MESH_M = 0.0125
"""Edge length of the meshes of base and band: sixteen sides around."""
DISSIPATION_S_M = 10.0
"""Hunt-Crossley: a bottle hit at 0.6 m/s hardly bounces (docs/decisions/0008)."""

RELAXATION_S = 0.020
"""Dissipation in a world with contact = "sap"."""

BOTTLE_COEFFICIENT = 1.0

SLOSH_RAD_S = math.sqrt(1.841 * GRAVITY_M_S2 / BOTTLE_RADIUS_M)
"""First sideways mode of a liquid in a cylinder, as deep as wide (1.841: first root of J1')."""
SLOSH_DAMPING_RATIO = 0.05
SLOSH_LIMIT_M = 0.02


def build_scene(
    plant: MultibodyPlant,
    tool_parent: Frame,
    X_PT: Array,
    parameters: Array,
    nuisance: Array,
    unmodelled: PushingUnmodelled | None,
) -> SceneBodies:
    """Add table, bottle and pusher, and set contact model and gravity. The pusher's body frame is T (see mount.py).

    Raises OutOfRange if the patch leaves the table.
    """
    effects = unmodelled or PushingUnmodelled()
    p = PARAMETERS.named(parameters)
    set_contact(plant, effects.contact)
    plant.mutable_gravity_field().set_gravity_vector(gravity_m_s2(*effects.table_tilt_rad))
    half_m = PATCH_SIZE_M * effects.patch_size_scale / 2
    area = (PATCH_X_M - half_m, PATCH_X_M + half_m), (p.y_p - half_m, p.y_p + half_m)
    patch = _sheet(_corners(*area), [(0, 1, 2), (0, 2, 3)])
    for name, sheet, friction in (("table", _table_around(*area), p.mu), ("patch", patch, p.mu_p)):
        properties = rigid(coefficient(friction, BOTTLE_COEFFICIENT))
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), sheet, name, properties)
    _add_bottle(plant, p.e, effects)
    _add_pusher(plant, tool_parent, X_PT)
    visuals = (table_visual(), patch_visual(*area), bottle_visual(OBJECT), *pusher_visuals(TOOL))
    return SceneBodies(tool=TOOL, object=OBJECT, visuals=visuals)


def _add_bottle(plant: MultibodyPlant, e_Pa: float, effects: PushingUnmodelled) -> None:
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
    inertia = SpatialInertia.SolidBoxWithMass(PLATE_MASS_KG, *PLATE_M).Shift(-vector(*PLATE_CENTRE_M))
    pusher: RigidBody = plant.AddRigidBody(TOOL, instance, inertia)
    plant.set_gravity_enabled(instance, False)
    plant.AddJoint(WeldJoint(TOOL + "_mount", parent, pusher.body_frame(), RigidTransform(X_PT)))
    properties = rigid(coefficient(PLATE_FRICTION, BOTTLE_COEFFICIENT))
    plant.RegisterCollisionGeometry(pusher, RigidTransform(vector(*PLATE_CENTRE_M)), Box(*PLATE_M), "plate", properties)
