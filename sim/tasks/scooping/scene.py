"""Table, piece and spatula in a Drake plant: the same physics whether an arm carries the tool or not.

Piece against table, blade and neck is compliant hydroelastic contact (the piece has the modulus, the others are rigid).
The edge rides on the table on two small rounded corners by point contact without friction; everything else
between blade and table is left out, so each step has few contacts.
"""

from __future__ import annotations

from pydrake.common import MemoryFile
from pydrake.geometry import Box, Convex, GeometryId, HalfSpace, InMemoryMesh, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    SpatialInertia,
    UnitInertia,
    WeldJoint,
)

from hw.types import Array
from perception.types import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.tasks.hardware import SceneBodies
from sim.tasks.scooping.params import CORNER_M, EDGE_M, PARAMETERS, PIECE_DENSITY_KG_M3, ScoopingUnmodelled
from sim.tasks.scooping.piece import Piece, blade, piece_of
from sim.tasks.scooping.plan import DEPTH_LIMIT_M, VERTICAL_STIFFNESS_N_M
from sim.tasks.scooping.spatula import (
    BLADE_MASS_KG,
    CORNERS_M,
    HANDLE_RISE_RAD,
    NECK_M,
    NECK_SIZE_M,
    ROOT_M,
    UP,
    spatula_visuals,
)
from sim.tasks.shared.contact import compliant, material, relaxing, rigid, set_contact, vector
from sim.tasks.shared.shapes import obj_text, table_visual
from sim.types import Visual

TOOL = "spatula"
OBJECT = "piece"
EDGE_RELAXATION_S = 0.0
"""With a larger value, SAP lets a pressed edge creep into the table, by 0.3 mm in a tenth of a second."""

FLEX_TIME_S = 0.010
"""Damping of a bent blade's return: nylon is well damped."""


def build_scene(
    plant: MultibodyPlant,
    tool_parent: Frame,
    X_PT: Array,
    parameters: Array,
    nuisance: Array,
    unmodelled: ScoopingUnmodelled | None,
) -> SceneBodies:
    """Add table, piece and spatula, and set the contact model. The spatula's body frame is T (see plan.py)."""
    effects = unmodelled or ScoopingUnmodelled()
    mu = PARAMETERS.named(parameters).mu
    set_contact(plant, effects.contact)
    table = plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "table", rigid(mu))
    _add_piece(plant, parameters, nuisance, effects)
    handle, turner = _add_spatula(plant, tool_parent, X_PT, effects)
    face = plant.RegisterCollisionGeometry(
        turner, RigidTransform(), _polyhedron(blade(effects.lip_m)), "blade", rigid(effects.friction_of_blade(mu))
    )
    neck = _add_neck(plant, handle, effects.friction_of_blade(mu))
    for name, p_T_m in (("corner_right", CORNERS_M[1]), ("corner_left", CORNERS_M[0])):
        corner = relaxing(material(0.0, effects.edge_stiffness_N_m), EDGE_RELAXATION_S)
        plant.RegisterCollisionGeometry(turner, RigidTransform(p_T_m), Sphere(CORNER_M), name, corner)
    piece = piece_of(parameters, nuisance, effects)
    visual = Visual(OBJECT, piece.vertices_m, piece.triangles, effects.colour)
    visuals = (table_visual(), visual, *spatula_visuals(TOOL, handle.name(), effects.lip_m))
    return SceneBodies(TOOL, OBJECT, visuals, apart=((face, table), (neck, table)))


def _add_piece(plant: MultibodyPlant, parameters: Array, nuisance: Array, effects: ScoopingUnmodelled) -> None:
    """The piece as a free body."""
    piece, p = piece_of(parameters, nuisance, effects), PARAMETERS.named(parameters)
    mass_kg = PIECE_DENSITY_KG_M3 * effects.density_scale * piece.volume_m3
    G = piece.unit_inertia_m2
    central = UnitInertia(G[0, 0], G[1, 1], G[2, 2], G[0, 1], G[0, 2], G[1, 2])
    inertia = SpatialInertia.MakeFromCentralInertia(mass_kg, vector(*effects.com_offset_m), central * mass_kg)
    body = plant.AddRigidBody(OBJECT, plant.AddModelInstance(OBJECT), inertia)
    soft = compliant(p.mu, p.e)
    plant.RegisterCollisionGeometry(body, RigidTransform(), _polyhedron(piece), OBJECT, soft)


def _add_spatula(
    plant: MultibodyPlant, parent: Frame, X_PT: Array, effects: ScoopingUnmodelled
) -> tuple[RigidBody, RigidBody]:
    """Add handle and blade.

    A pitch or distance bias rotates or shifts the mount about the edge. A flexible blade is hinged at its root, with
    the stiffness that bends it by `blade_flex_rad` at the full depth.
    """
    instance = plant.AddModelInstance(TOOL)
    inertia = SpatialInertia.SolidBoxWithMass(BLADE_MASS_KG, BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M)
    handle = plant.AddRigidBody(TOOL + "_handle", instance, inertia)
    blade = plant.AddRigidBody(TOOL, instance, inertia.Shift(vector(BLADE_LENGTH_M / 2, 0.0, EDGE_M / 2)))
    plant.set_gravity_enabled(instance, False)
    bias = RigidTransform(RollPitchYaw(0.0, effects.pitch_bias_rad, 0.0), vector(-effects.distance_bias_m, 0.0, 0.0))
    plant.AddJoint(WeldJoint(TOOL + "_mount", parent, handle.body_frame(), RigidTransform(X_PT) @ bias))
    if effects.blade_flex_rad == 0.0:
        plant.AddJoint(WeldJoint(TOOL + "_root", handle.body_frame(), blade.body_frame(), RigidTransform()))
        return handle, blade
    stiffness_Nm = VERTICAL_STIFFNESS_N_M * DEPTH_LIMIT_M * BLADE_LENGTH_M / effects.blade_flex_rad
    X_TR = RigidTransform(vector(-BLADE_LENGTH_M, 0.0, 0.0))
    above, below = (
        plant.AddFrame(FixedOffsetFrame(f"{body.name()}_root", body.body_frame(), X_TR)) for body in (handle, blade)
    )
    axis = vector(0.0, 1.0, 0.0)
    joint = plant.AddJoint(RevoluteJoint(TOOL + "_root", above, below, axis, stiffness_Nm * FLEX_TIME_S))
    plant.AddForceElement(RevoluteSpring(joint, 0.0, stiffness_Nm))
    return handle, blade


def _add_neck(plant: MultibodyPlant, handle: RigidBody, friction: float) -> GeometryId:
    """Add the neck, between the root of the blade and the handle."""
    X_TG = RigidTransform(RollPitchYaw(0.0, HANDLE_RISE_RAD, 0.0), vector(*(ROOT_M + NECK_M / 2 * UP)))
    neck: GeometryId = plant.RegisterCollisionGeometry(handle, X_TG, Box(*NECK_SIZE_M), "neck", rigid(friction))
    return neck


def _polyhedron(solid: Piece) -> Convex:
    return Convex(
        InMemoryMesh(mesh_file=MemoryFile(obj_text(solid.vertices_m, solid.triangles), ".obj", "solid.obj")), 1.0
    )
