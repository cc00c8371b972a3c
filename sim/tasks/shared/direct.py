"""Rollouts of a task's scene in Drake without an arm: a carriage drives the tool."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from pydrake.systems.primitives import TrajectorySource

from hw.types import Array
from sim.tasks.hardware import BuildScene
from sim.tasks.shared.carriage import Drive
from sim.tasks.shared.contact import keep_apart, vector
from sim.tasks.shared.readings import Course, Moment, Velocity

CARRIAGE = "carriage"
_JOINTS = ("forward", "up", "pitch")


class Drake:
    """A scene at the start of a course, as `sim.tasks.shared.readings.Physics`.

    A step at time t gives the state at t + dt. The clock runs half a step early, so that rounding never decides whether
    the step of a reading has been taken.
    """

    def __init__(
        self, course: Course, build: BuildScene, dt_s: float, parameters: Array, nuisance: Array, unmodelled: Any = None
    ) -> None:
        """`build` adds the scene, with its tool on the carriage. With `dt_s` 0 the caller has to choose an
        integrator."""
        robot = RobotDiagramBuilder(time_step=dt_s)  # a plain DiagramBuilder leaks some 150 KB a rollout in pydrake
        builder, plant = robot.builder(), robot.plant()
        plant.SetUseSampledOutputPorts(False)  # nobody reads the ports that would be cached
        self.bodies = build(plant, add_carriage(plant, course.drive), np.eye(4), parameters, nuisance, unmodelled)
        keep_apart(robot.scene_graph(), self.bodies.apart)
        plant.Finalize()
        source = builder.AddSystem(TrajectorySource(course.drive.trajectory))
        port = plant.get_desired_state_input_port(plant.GetModelInstanceByName(CARRIAGE))
        builder.Connect(source.get_output_port(), port)
        self.simulator, self.plant, self._dt_s = Simulator(robot.Build()), plant, dt_s
        self.simulator.get_mutable_context().SetTime(course.start_s - dt_s / 2)
        self._state = plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self._object, self._tool = (plant.GetBodyByName(name) for name in (self.bodies.object, self.bodies.tool))
        plant.SetFreeBodyPose(self._state, self._object, RigidTransform(course.X_BO))
        place_carriage(plant, self._state, course.tool)

    def now(self, t_s: float) -> Moment:
        """See `Physics`."""
        X_BO, X_BT = (body.EvalPoseInWorld(self._state) for body in (self._object, self._tool))
        return Moment(t_s, X_BO, X_BT, self._velocity(self._object), self._velocity(self._tool))

    def advance_to(self, t_s: float) -> None:
        """See `Physics`."""
        self.simulator.AdvanceTo(t_s - self._dt_s / 2)

    def _velocity(self, body: RigidBody) -> Velocity:
        V = body.EvalSpatialVelocityInWorld(self._state)
        return V.translational(), V.rotational()


def add_carriage(plant: MultibodyPlant, drive: Drive) -> Frame:
    """Add the carriage and return the frame T that it carries."""
    arm = drive.compliance
    instance = plant.AddModelInstance(CARRIAGE)
    origin = plant.AddFrame(FixedOffsetFrame("carriage_start", plant.world_frame(), RigidTransform(drive.X_BP)))
    p_PM_m = vector(arm.p_PM_m[0], 0.0, arm.p_PM_m[1])
    about = UnitInertia(*[arm.inertia_kg_m2 / arm.mass_kg] * 3)
    inertia = SpatialInertia.MakeFromCentralInertia(arm.mass_kg, p_PM_m, about * arm.mass_kg)
    parts = (SpatialInertia.Zero(), SpatialInertia.Zero(), inertia)
    bodies = [plant.AddRigidBody(f"{CARRIAGE}_{name}", instance, M) for name, M in zip(_JOINTS, parts, strict=True)]
    frames = [origin, *(body.body_frame() for body in bodies)]
    joints = [
        PrismaticJoint("forward", frames[0], frames[1], vector(1.0, 0.0, 0.0)),
        PrismaticJoint("up", frames[1], frames[2], vector(0.0, 0.0, 1.0)),
        RevoluteJoint("pitch", frames[2], frames[3], vector(0.0, 1.0, 0.0)),
    ]
    for joint, stiffness, damping in zip(joints, arm.stiffness, arm.damping, strict=True):
        actuator = plant.AddJointActuator(joint.name(), plant.AddJoint(joint))
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
    plant.set_gravity_enabled(instance, False)
    X_PT = RigidTransform(vector(-arm.p_TP_m[0], 0.0, -arm.p_TP_m[1]))
    tool: Frame = plant.AddFrame(FixedOffsetFrame("carriage_tool", frames[3], X_PT))
    return tool


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
