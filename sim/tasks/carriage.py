"""What carries the tool in a training rollout: forward, up and pitch, each through a critically damped spring.

The springs are part of Drake's implicit solver. Only the vertical one matters, where a tool presses on the table; the
others are stiff enough that they do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
from sim.types import ToolMotion

CARRIAGE = "carriage"
MASS_KG = 1.0
UNIT_INERTIA_M2 = 0.01
FORWARD_STIFFNESS_N_M = 2e4
PITCH_STIFFNESS_NM = 400.0
_KNOT_EVERY = 4  # samples of the motion between two knots of the drive


@dataclass(frozen=True)
class VerticalSpring:
    """How the tool gives way up and down."""

    stiffness_N_m: float
    damping_Ns_m: float


@dataclass(frozen=True, eq=False)
class Drive:
    """A motion in one vertical plane, as the carriage follows it."""

    X_BP: Array  # (4, 4) X along the plane at table height, Z up; its origin is the plane's nearest to that of B
    trajectory: PiecewisePolynomial  # (6,) forward, up and pitch of T in P, and their rates
    vertical: VerticalSpring


def drive_of(motion: ToolMotion, vertical: VerticalSpring) -> Drive:
    """The drive of a motion whose tool stays in one vertical plane, linear between knots."""
    X_BT = motion.X_BT
    left = X_BT[0, :2, 1]
    ahead = np.array([left[1], -left[0]])
    X_BP = np.eye(4)
    X_BP[:2, 0], X_BP[:2, 1], X_BP[:2, 3] = ahead, left, (left @ X_BT[0, :2, 3]) * left
    pitch_rad = np.arctan2(X_BT[:, :2, 2] @ ahead, X_BT[:, :2, 0] @ ahead)
    q = np.stack([X_BT[:, :2, 3] @ ahead, X_BT[:, 2, 3], pitch_rad])
    rates = np.gradient(q, motion.t_s, axis=1)
    knots = slice(None, None, _KNOT_EVERY)
    trajectory = PiecewisePolynomial.FirstOrderHold(motion.t_s[knots], np.concatenate([q, rates])[:, knots])
    return Drive(X_BP, trajectory, vertical)


def add_carriage(plant: MultibodyPlant, drive: Drive) -> Frame:
    """Add the carriage; its frame is T as commanded."""
    instance = plant.AddModelInstance(CARRIAGE)
    origin = plant.AddFrame(FixedOffsetFrame("carriage_start", plant.world_frame(), RigidTransform(drive.X_BP)))
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
        (drive.vertical.stiffness_N_m, drive.vertical.damping_Ns_m),
        (PITCH_STIFFNESS_NM, 2.0 * math.sqrt(PITCH_STIFFNESS_NM * MASS_KG * UNIT_INERTIA_M2)),
    ]
    for joint, (stiffness, damping) in zip(joints, gains, strict=True):
        actuator = plant.AddJointActuator(joint.name(), plant.AddJoint(joint))
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
    plant.set_gravity_enabled(instance, False)
    carriage: Frame = frames[3]
    return carriage


def place_carriage(plant: MultibodyPlant, state: Context, start: Array) -> None:
    """Put the carriage at `start` (6,): forward, up, pitch and their rates."""
    x_m, z_m, pitch_rad, vx_m_s, vz_m_s, rate_rad_s = start
    forward, up, pitch = (plant.GetJointByName(name) for name in ("forward", "up", "pitch"))
    forward.set_translation(state, x_m)
    forward.set_translation_rate(state, vx_m_s)
    up.set_translation(state, z_m)
    up.set_translation_rate(state, vz_m_s)
    pitch.set_angle(state, pitch_rad)
    pitch.set_angular_rate(state, rate_rad_s)
