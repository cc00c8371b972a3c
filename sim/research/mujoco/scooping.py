"""Scooping in MuJoCo.

The piece's surface is a bed of points (`bed`) against table, blade and neck. Each has the stiffness of its share of the
surface in hydroelastic contact, and training's relaxation time. The edge rides on the table on the same two corners.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from hw.dynamics import GRAVITY_M_S2
from hw.types import Array
from perception.types import BLADE_LENGTH_M, BLADE_WIDTH_M, ObjectTrack
from sim.research.mujoco.contact import POINT_M, Bed, add_pair, bed_of, set_softness
from sim.research.mujoco.stepping import OBJECT, TOOL, add_carriage, new_scene, quaternion, run, set_inertia, written
from sim.tasks.scooping.params import (
    CORNER_M,
    EDGE_M,
    LIP_M,
    PARAMETERS,
    PIECE_DENSITY_KG_M3,
    SQUARE_LIP_M,
    ScoopingUnmodelled,
)
from sim.tasks.scooping.piece import SLOPE, Piece, blade, piece_of, sink_m
from sim.tasks.scooping.plan import DEPTH_LIMIT_M, VERTICAL_STIFFNESS_N_M, plan
from sim.tasks.scooping.rollout import course_of, rest_pose, track_of
from sim.tasks.scooping.scene import FLEX_TIME_S
from sim.tasks.scooping.spatula import BLADE_MASS_KG, HANDLE_RISE_RAD, NECK_M, NECK_SIZE_M, ROOT_M, UP
from sim.tasks.shared.carriage import Drive
from sim.tasks.shared.contact import RELAXATION_TIME_S, vector
from sim.tasks.shared.readings import Course, Readings
from sim.types import ToolMotion

STEP_S = 0.00025

EDGE_DAMPING_S = 0.002
"""Ratio of damper to spring for the corners on the table, s."""

_SHARP_M, _BELOW_M = 0.0025, 0.005  # the first with training's lip; a square edge has none
_CORNERS = {"corner_left": 1.0, "corner_right": -1.0}
_UNTOUCHED = {"contype": 0, "conaffinity": 0}
"""Contact flags of every geom: only named pairs touch."""


def simulate(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None = None
) -> ObjectTrack:
    """Scoop once (see `sim.tasks.task.Simulate`)."""
    motion, X_BO = plan(context, action), rest_pose(context, parameters, nuisance, unmodelled)
    return track_of(readings(motion, X_BO, parameters, nuisance, unmodelled), motion)


def readings(
    motion: ToolMotion, X_BO: Array, parameters: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None
) -> Readings:
    """The readings of the motion against a piece at X_BO (4, 4)."""
    effects = unmodelled or ScoopingUnmodelled()
    course = course_of(motion, X_BO, nuisance, unmodelled)
    return run(course, scene(course.drive, parameters, nuisance, effects), effects.dt_s or STEP_S)


def mjcf(course: Course, parameters: Array, nuisance: Array) -> str:
    """The scene at the start of a trial as a file."""
    spec, model = _scene(course.drive, parameters, nuisance, ScoopingUnmodelled())
    return written(spec, model, course)


def scene(drive: Drive, parameters: Array, nuisance: Array, effects: ScoopingUnmodelled) -> Any:
    """The compiled model: table, piece, and spatula on its carriage."""
    return _scene(drive, parameters, nuisance, effects)[1]


def _scene(drive: Drive, parameters: Array, nuisance: Array, effects: ScoopingUnmodelled) -> tuple[Any, Any]:
    """Specification and compiled model."""
    piece = piece_of(parameters, nuisance, effects)
    mass_kg = PIECE_DENSITY_KG_M3 * effects.density_scale * piece.volume_m3
    spec = new_scene(np.array([0.0, 0.0, -GRAVITY_M_S2]))
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(2.0, 2.0, 0.1), **_UNTOUCHED)
    _add_spatula(spec, add_carriage(spec, drive), effects)
    p = PARAMETERS.named(parameters)
    bed = bed_of(piece, round(p.g))
    _add_piece(spec, bed, piece, mass_kg, effects)
    sticky = p.mu * effects.second_friction_scale
    for i in range(len(bed.points_m)):
        for other, friction in (("table", p.mu), ("blade", sticky), ("neck", sticky)):
            add_pair(spec, f"{other}_{i}", f"point_{i}", other, friction)
    for corner in _CORNERS:
        add_pair(spec, corner, corner, "table", 0.0)
    spec.option.timestep = STEP_S
    model = spec.compile()
    springs_N_m = bed.stiffness_N_m(mass_kg * GRAVITY_M_S2, sink_m(piece, mass_kg, p.e))
    _soften(model, springs_N_m, effects.edge_stiffness_N_m)
    return spec, model


def _add_piece(spec: Any, bed: Bed, piece: Piece, mass_kg: float, effects: ScoopingUnmodelled) -> None:
    body = spec.worldbody.add_body(name=OBJECT)
    body.add_freejoint(name=OBJECT)
    set_inertia(body, mass_kg, effects.com_offset_m, mass_kg * piece.unit_inertia_m2)
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    for i, p_m in enumerate(bed.points_m):
        body.add_geom(name=f"point_{i}", type=sphere, size=(POINT_M, 0, 0), pos=p_m, **_UNTOUCHED)


def _add_spatula(spec: Any, parent: Any, effects: ScoopingUnmodelled) -> None:
    """Add handle and blade, mounted and hinged as in training (`sim.tasks.scooping.scene`)."""
    rotation = RollPitchYaw(0.0, effects.pitch_bias_rad, 0.0)
    bias = RigidTransform(rotation, vector(-effects.distance_bias_m, 0.0, 0.0))
    handle = parent.add_body(name="handle", pos=bias.translation(), quat=quaternion(bias))
    turner = handle.add_body(name=TOOL)
    edges_m = np.array([BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M])
    central = BLADE_MASS_KG / 12.0 * np.diag((edges_m**2).sum() - edges_m**2)
    for body, centre_m in ((handle, (0.0, 0.0, 0.0)), (turner, (-BLADE_LENGTH_M / 2, 0.0, -EDGE_M / 2))):
        body.gravcomp = 1.0
        set_inertia(body, BLADE_MASS_KG, centre_m, central)
    if effects.blade_flex_rad > 0.0:
        stiffness_Nm = VERTICAL_STIFFNESS_N_M * DEPTH_LIMIT_M * BLADE_LENGTH_M / effects.blade_flex_rad
        hinge = turner.add_joint(name="root", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 1.0, 0.0))
        hinge.pos = (-BLADE_LENGTH_M, 0.0, 0.0)
        hinge.stiffness, hinge.damping = (stiffness_Nm, 0.0, 0.0), (stiffness_Nm * FLEX_TIME_S, 0.0, 0.0)
    _add_blade(spec, turner, effects.lip_m)
    tilt = RigidTransform(RollPitchYaw(0.0, HANDLE_RISE_RAD, 0.0), vector(*(ROOT_M + NECK_M / 2 * UP)))
    half_m = np.array(NECK_SIZE_M) / 2
    box = mujoco.mjtGeom.mjGEOM_BOX
    handle.add_geom(name="neck", type=box, size=half_m, pos=tilt.translation(), quat=quaternion(tilt), **_UNTOUCHED)
    for name, side in _CORNERS.items():
        p_m = (0.0, side * (BLADE_WIDTH_M - EDGE_M) / 2, -EDGE_M + CORNER_M)
        turner.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(CORNER_M, 0, 0), pos=p_m, **_UNTOUCHED)


def _add_blade(spec: Any, body: Any, lip_m: float) -> None:
    """The blade for contact with the points: the bevel continues beyond the edge, down into the table, and the whole
    blade reaches `_BELOW_M` further down, so that a point inside is pushed upwards.
    """
    solid, sharp_m = blade(lip_m).vertices_m, _SHARP_M * (SQUARE_LIP_M - lip_m) / (SQUARE_LIP_M - LIP_M)
    lip = solid[(solid[:, 0] == 0.0) & (solid[:, 2] > -SQUARE_LIP_M)]
    face = solid[(solid[:, 0] < 0.0) & (solid[:, 2] == 0.0)]
    tip = lip + np.array([sharp_m, 0.0, -SLOPE * sharp_m])
    vertices_m = np.concatenate([face, tip, tip - [0.0, 0.0, _BELOW_M], face - [0.0, 0.0, _BELOW_M]])
    spec.add_mesh(name="blade", uservert=vertices_m.ravel())
    body.add_geom(name="blade", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="blade", **_UNTOUCHED)


def _soften(model: Any, stiffness_N_m: Array, edge_N_m: float) -> None:
    for corner in _CORNERS:
        set_softness(model, corner, edge_N_m, edge_N_m * EDGE_DAMPING_S)
    for i, each in enumerate(stiffness_N_m):
        for other in ("table", "blade", "neck"):
            set_softness(model, f"{other}_{i}", each, each * RELAXATION_TIME_S)
