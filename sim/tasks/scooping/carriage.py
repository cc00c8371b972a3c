"""What carries the spatula in a training rollout: forward, up and pitch, each through a critically damped spring.

The springs are part of Drake's implicit solver. The vertical one is what depth was planned with (plan.py); the
others are stiff enough that they do not matter.
"""

from __future__ import annotations

import math

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context
from pydrake.trajectories import PiecewisePolynomial

from hw.types import Array
from sim.drake_types import vector
from sim.tasks.scooping.plan import VERTICAL_DAMPING_NS_M, VERTICAL_STIFFNESS_N_M, edge_height_m
from sim.types import ToolMotion

CARRIAGE = "carriage"
MASS_KG = 1.0
UNIT_INERTIA_M2 = 0.01
FORWARD_STIFFNESS_N_M = 2e4
PITCH_STIFFNESS_NM = 400.0
_KNOT_EVERY = 4  # samples of the motion between two knots of the drive


def add_carriage(plant: MultibodyPlant, y_m: float) -> Frame:
    """Add the carriage, moving in the plane y = `y_m`; its frame is T as commanded."""
    instance = plant.AddModelInstance(CARRIAGE)
    origin = plant.AddFrame(
        FixedOffsetFrame("carriage_start", plant.world_frame(), RigidTransform(vector(0.0, y_m, 0.0)))
    )
    inertia = SpatialInertia(MASS_KG, vector(0.0, 0.0, 0.0), UnitInertia(*[UNIT_INERTIA_M2] * 3))
    parts = (("forward", SpatialInertia.Zero()), ("up", SpatialInertia.Zero()), ("pitch", inertia))
    frames = [origin, *(plant.AddRigidBody(f"{CARRIAGE}_{name}", instance, M).body_frame() for name, M in parts)]
    joints = [
        PrismaticJoint("forward", frames[0], frames[1], vector(1.0, 0.0, 0.0)),
        PrismaticJoint("up", frames[1], frames[2], vector(0.0, 0.0, 1.0)),
        RevoluteJoint("pitch", frames[2], frames[3], vector(0.0, 1.0, 0.0)),
    ]
    gains = [
        (FORWARD_STIFFNESS_N_M, 2.0 * math.sqrt(FORWARD_STIFFNESS_N_M * MASS_KG)),
        (VERTICAL_STIFFNESS_N_M, VERTICAL_DAMPING_NS_M),
        (PITCH_STIFFNESS_NM, 2.0 * math.sqrt(PITCH_STIFFNESS_NM * MASS_KG * UNIT_INERTIA_M2)),
    ]
    for joint, (stiffness, damping) in zip(joints, gains, strict=True):
        actuator = plant.AddJointActuator(joint.name(), plant.AddJoint(joint))
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
    plant.set_gravity_enabled(instance, False)
    carriage: Frame = frames[3]
    return carriage


def drive_of(motion: ToolMotion) -> PiecewisePolynomial:
    """(x, z, pitch) of T and their rates over time, linear between knots."""
    X_BT = motion.X_BT
    q = np.stack([X_BT[:, 0, 3], X_BT[:, 2, 3], np.arctan2(X_BT[:, 0, 2], X_BT[:, 0, 0])])
    rates = np.gradient(q, motion.t_s, axis=1)
    knots = slice(None, None, _KNOT_EVERY)
    drive: PiecewisePolynomial = PiecewisePolynomial.FirstOrderHold(
        motion.t_s[knots], np.concatenate([q, rates])[:, knots]
    )
    return drive


def place_carriage(plant: MultibodyPlant, state: Context, desired: Array) -> None:
    """Put the carriage where its command (6,) has it, except that the table holds the edge up."""
    x_m, z_m, pitch_rad, vx_m_s, vz_m_s, rate_rad_s = desired
    floor_m = float(edge_height_m(pitch_rad))
    forward, up, pitch = (plant.GetJointByName(name) for name in ("forward", "up", "pitch"))
    forward.set_translation(state, x_m)
    forward.set_translation_rate(state, vx_m_s)
    up.set_translation(state, max(z_m, floor_m))
    up.set_translation_rate(state, vz_m_s if z_m > floor_m else 0.0)
    pitch.set_angle(state, pitch_rad)
    pitch.set_angular_rate(state, rate_rad_s)
