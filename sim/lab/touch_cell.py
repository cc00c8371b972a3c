"""The lab's physics of a touch: arm, table and the tool in the hand, advanced in pieces so that a touch can stop it.

The same springs in the joints as in `sim.lab.cell`. The external torque is the load of these springs: stiffness times
deflection, plus damping. The grip of the fingers yields in rotation when the load exceeds its limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Box, HalfSpace, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    PdControllerGains,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from hw.collision import KeepOut
from hw.types import PATH_RATE_HZ, Array, JointPath
from sim.lab.cell import DAMPING_NMS_RAD, STIFFNESS_NM_RAD, hold, make_position_controlled
from sim.lab.world import World
from sim.panda.model import FLANGE_NAME, JOINT_NAMES, add_panda
from sim.panda.tool import FINGERTIPS, Feeler
from sim.tasks.shared.contact import RELAXATION_TIME_S, keep_apart, material, relaxing, rigid, set_contact, vector
from sim.tasks.task import Task

STEP_S = 0.0025
FEELER_STIFFNESS_N_M = 2e5
"""Stiffness of fingertips, and of a tool whose world states no stiffness of its edge."""
GRIP_NM_RAD, GRIP_NMS_RAD = 4000.0, 4.0
_GRIP_M = 0.1034  # from the flange to the middle of the grip
_GRIP = "grip"
_OUT_OF_THE_WAY_M = 20.0
_BASE_FRICTION = 0.3
_KNOT_EVERY = 5  # samples of a path between two knots of the springs' trajectory


@dataclass(frozen=True, eq=False)
class Felt:
    """A part of a motion at 1 kHz: commanded joints, true joints, external torques."""

    t_s: Array  # (M,)
    commanded_rad: Array  # (M, 7)
    q_rad: Array  # (M, 7)
    torque_Nm: Array  # (M, 7) of external forces


class TouchCell:
    """One plant: with the task's tool in the fingers, or with only the closed fingers."""

    def __init__(
        self, task: Task, world: World, feelers: tuple[Feeler, ...] | None, things: tuple[KeepOut, ...] = ()
    ) -> None:
        """`feelers` of the tool; None: no tool, closed fingers. `things` are boxes on the table, in W."""
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(time_step=STEP_S, use_sampled_output_ports=False)
        plant, self._scene_graph = AddMultibodyPlant(config, builder)
        self._plant, self._object = plant, None
        arm = add_panda(plant, X_WB=world.mount.true.X_WB)
        make_position_controlled(plant, arm)
        flange = plant.GetFrameByName(FLANGE_NAME)
        self._grip_limit_Nm = float("inf")
        if feelers is None:
            set_contact(plant, "sap")
            plant.RegisterCollisionGeometry(
                plant.world_body(), RigidTransform(), HalfSpace(), "table", rigid(_BASE_FRICTION)
            )
            _add_balls(plant, plant.GetBodyByName(FLANGE_NAME), (FINGERTIPS,))
        else:
            self._add_tool(task, world, flange, feelers)
        for thing in things:
            centre, size = (thing.low_m + thing.high_m) / 2.0, thing.high_m - thing.low_m
            plant.RegisterCollisionGeometry(
                plant.world_body(), RigidTransform(centre), Box(*size), thing.name, material(_BASE_FRICTION)
            )
        plant.Finalize()
        self._reference = TrajectorySource(hold(np.zeros(7)), 1)
        builder.AddSystem(self._reference)
        builder.Connect(self._reference.get_output_port(), plant.get_desired_state_input_port(arm))
        self._grip_port = plant.get_desired_state_input_port(self._grip) if feelers is not None else None
        if self._grip_port is not None:
            builder.ExportInput(self._grip_port, _GRIP)
        self._log = LogVectorOutput(plant.get_state_output_port(), builder, publish_period=STEP_S)
        self._diagram = builder.Build()
        self._simulator = Simulator(self._diagram)
        self._root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root)
        joints = [plant.GetJointByName(name) for name in JOINT_NAMES]
        self._q = np.array([joint.position_start() for joint in joints])
        self._v = plant.num_positions() + np.array([joint.velocity_start() for joint in joints])
        self._turned_rad = 0.0
        self._hold_grip()

    @property
    def turned_rad(self) -> float:
        """Rotation (rad) by which the tool has slipped in the fingers since it was grasped."""
        return self._turned_rad

    def holds_at_most(self, torque_Nm: float) -> None:
        """Set the torque limit of the grip, across the fingers, from now on."""
        self._grip_limit_Nm = torque_Nm

    def start(self, path: JointPath) -> None:
        """Put the arm at rest at the path's start, with unloaded springs; time restarts."""
        positions = self._plant.GetDefaultPositions()
        positions[self._q] = path.q_rad[0]
        if self._object is not None:
            X = RigidTransform(vector(0.0, 0.0, _OUT_OF_THE_WAY_M))
            self._plant.SetDefaultFloatingBaseBodyPose(self._object, X)
            positions = self._plant.GetDefaultPositions()
            positions[self._q] = path.q_rad[0]
            positions[self._grip_joint.position_start()] = self._turned_rad
        self._root.SetTime(0.0)
        self._plant.SetPositions(self._context, positions)
        self._plant.SetVelocities(self._context, np.zeros(self._plant.num_velocities()))
        self.follow(path)
        self._log.FindMutableLog(self._root).Clear()
        self._simulator.Initialize()

    def follow(self, path: JointPath) -> None:
        """Follow `path` from now on; its past must equal that of the previous path."""
        self._path = path
        knots = np.unique(np.append(np.arange(0, len(path.t_s), _KNOT_EVERY), len(path.t_s) - 1))
        self._reference.UpdateTrajectory(PiecewisePolynomial.FirstOrderHold(path.t_s[knots], path.q_rad[knots].T))

    def advance(self, to_s: float) -> Felt:
        """Advance to `to_s`, a multiple of the step -> the readings since the last call.

        Raises RuntimeError (Drake).
        """
        begin_s = self._root.get_time()
        self._simulator.AdvanceTo(to_s)
        self._slip()
        log = self._log.FindMutableLog(self._root)
        at_s, rows = np.array(log.sample_times()), np.array(log.data()).T
        inside = at_s >= begin_s - 2.0 * STEP_S
        t_s = np.arange(round(begin_s * PATH_RATE_HZ), round(to_s * PATH_RATE_HZ)) / PATH_RATE_HZ
        return self._felt(t_s, at_s[inside], rows[inside])

    def _felt(self, t_s: Array, at_s: Array, rows: Array) -> Felt:
        """The load of the springs follows from the states; each step is pulled towards the path's place before it."""
        q, v = rows[:, self._q], rows[:, self._v]
        target, after = self._commanded(at_s - STEP_S), self._commanded(at_s)
        spring = np.array(STIFFNESS_NM_RAD) * (target - q) + np.array(DAMPING_NMS_RAD) * ((after - target) / STEP_S - v)
        both = np.concatenate([q, -spring], axis=1)
        dense = np.stack([np.interp(t_s, at_s, column) for column in both.T], axis=-1)
        return Felt(t_s, self._commanded(t_s), dense[:, :7], dense[:, 7:])

    def _commanded(self, t_s: Array) -> Array:
        return np.stack([np.interp(t_s, self._path.t_s, column) for column in self._path.q_rad.T], axis=-1)

    def _add_tool(self, task: Task, world: World, flange: Frame, feelers: tuple[Feeler, ...]) -> None:
        """Add the task's own scene, so that a misaligned mount or a flexible blade is the same. Its object is away."""
        plant, hardware = self._plant, task.require_hardware()
        X_FT = world.mount.true.X_FT(hardware.X_FT)
        self._grip = plant.AddModelInstance(_GRIP)
        inertia = SpatialInertia(0.1, vector(0.0, 0.0, 0.0), UnitInertia(1e-3, 1e-3, 1e-3))
        body = plant.AddRigidBody(_GRIP, self._grip, inertia)
        at = RigidTransform(vector(0.0, 0.0, _GRIP_M))
        above = plant.AddFrame(FixedOffsetFrame("fingers", flange, at))
        self._grip_joint = plant.AddJoint(RevoluteJoint(_GRIP, above, body.body_frame(), vector(*hardware.X_FT[:3, 1])))
        actuator = plant.AddJointActuator(_GRIP, self._grip_joint)
        actuator.set_controller_gains(PdControllerGains(p=GRIP_NM_RAD, d=GRIP_NMS_RAD))
        plant.set_gravity_enabled(self._grip, False)
        X_GT = at.inverse() @ RigidTransform(X_FT)
        bodies = hardware.build_scene(
            plant, body.body_frame(), X_GT.GetAsMatrix4(), world.parameters, world.nuisance, world.unmodelled
        )
        keep_apart(self._scene_graph, bodies.apart)
        self._object = plant.GetBodyByName(bodies.object)
        plant.set_gravity_enabled(self._object.model_instance(), False)
        blade = plant.GetBodyByName(bodies.tool)
        stiffness_N_m = float(getattr(world.unmodelled, "edge_stiffness_N_m", FEELER_STIFFNESS_N_M))
        _add_balls(plant, blade, self._without_own_balls(blade, feelers), stiffness_N_m)

    def _without_own_balls(self, body: RigidBody, feelers: tuple[Feeler, ...]) -> tuple[Feeler, ...]:
        """The feelers at whose place the task's scene has no ball yet: a second one would make it twice as stiff."""
        inspector = self._scene_graph.model_inspector()
        own = [
            inspector.GetPoseInFrame(one).translation()
            for one in self._plant.GetCollisionGeometriesForBody(body)
            if isinstance(inspector.GetShape(one), Sphere)
        ]
        return tuple(f for f in feelers if not any(np.abs(p_T_m - f.p_T_m).max() < 1e-9 for p_T_m in own))

    def _slip(self) -> None:
        """Rotate a grip that is loaded beyond its limit until its load equals the limit."""
        if self._object is None:
            return
        angle = self._grip_joint.get_angle(self._context)
        torque_Nm = GRIP_NM_RAD * (self._turned_rad - angle)
        beyond_Nm = abs(torque_Nm) - self._grip_limit_Nm
        if beyond_Nm > 0.0:
            self._turned_rad -= float(np.sign(torque_Nm)) * beyond_Nm / GRIP_NM_RAD
            self._hold_grip()

    def _hold_grip(self) -> None:
        if self._grip_port is not None:
            self._diagram.GetInputPort(_GRIP).FixValue(self._root, np.array([self._turned_rad, 0.0]))


def _add_balls(
    plant: MultibodyPlant, body: RigidBody, feelers: tuple[Feeler, ...], stiffness_N_m: float = FEELER_STIFFNESS_N_M
) -> None:
    for feeler in feelers:
        properties = relaxing(material(0.0, stiffness_N_m), RELAXATION_TIME_S)
        plant.RegisterCollisionGeometry(
            body, RigidTransform(feeler.p_T_m), Sphere(feeler.radius_m), f"feeler: {feeler.name}", properties
        )
