"""The lab's physics: a whole arm, its tool, the table and the object in one Drake plant.

The arm is position controlled like the real one. A stiff spring and a damper in every joint pull it along the path, and
the controller carries its weight. The plant integrates both implicitly. Tracking error and the yielding of the tool on
the table follow from this; nothing is added by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import QueryObject
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from hw.types import Array
from perception.types import REST_M_S, REST_RAD_S, REST_S, SETTLE_S
from sim.lab.world import World
from sim.panda.model import FLANGE_NAME, JOINT_NAMES, add_panda
from sim.panda.shapes import visuals
from sim.tasks.shared.contact import keep_apart
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class PlantMotion:
    """Positions of the whole plant, and of the arm in it, over time."""

    t_s: Array  # (M,) increasing
    positions: Array  # (M, nq)
    q_rad: Array  # (M, 7)

    def at(self, times_s: Array) -> Array:
        """Plant positions (S, nq) at `times_s` (S,): linear in between, constant beyond the ends.

        Quaternions are interpolated by component, which is exact enough between samples a few milliseconds apart.
        """
        return np.stack([np.interp(times_s, self.t_s, column) for column in self.positions.T], axis=-1)

    def arm_at(self, times_s: Array) -> Array:
        """Joint positions (S, 7) at `times_s` (S,)."""
        return np.stack([np.interp(times_s, self.t_s, column) for column in self.q_rad.T], axis=-1)


class DivergedError(Exception):
    """The solver gave up; `motion` is the motion until then."""

    def __init__(self, t_s: float, reason: str, motion: PlantMotion) -> None:
        super().__init__(f"the lab's simulation failed {t_s:.3f} s into the path: {reason}")
        self.motion = motion


STIFFNESS_NM_RAD = (3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0)
"""Joint impedance of the maker's examples (`setJointImpedance` in libfranka)."""

DAMPING_NMS_RAD = (150.0, 165.0, 130.0, 100.0, 20.0, 20.0, 15.0)
"""About critical damping for the inertia that each joint moves with the arm at the table; the maker publishes none."""

SETTLE_MIN_S, PIECE_S = 0.3, 0.1


class Cell:
    """Arm, tool, table and object of one world, with their present state. Time restarts with every motion."""

    def __init__(self, task: Task, world: World) -> None:
        hardware, builder = task.require_hardware(), DiagramBuilder()
        dt_s = hardware.time_step_s(world.unmodelled)
        config = MultibodyPlantConfig(time_step=dt_s, use_sampled_output_ports=False)
        self._plant, scene_graph = AddMultibodyPlant(config, builder)
        arm = add_panda(self._plant, X_WB=world.mount.true.X_WB)
        flange = self._plant.GetFrameByName(FLANGE_NAME)
        self.bodies = hardware.build_scene(
            self._plant,
            flange,
            world.mount.true.X_FT(hardware.X_FT),
            world.parameters,
            world.nuisance,
            world.unmodelled,
        )
        keep_apart(scene_graph, self.bodies.apart)
        self.visuals = (*visuals(), *self.bodies.visuals)
        make_position_controlled(self._plant, arm)
        self._plant.Finalize()
        self._reference = TrajectorySource(hold(np.zeros(7)), 1)
        builder.AddSystem(self._reference)
        builder.Connect(self._reference.get_output_port(), self._plant.get_desired_state_input_port(arm))
        self._log = LogVectorOutput(self._plant.get_state_output_port(), builder, publish_period=dt_s)
        diagram = builder.Build()
        self._simulator = Simulator(diagram)
        root = self._simulator.get_mutable_context()
        self._context = self._plant.GetMyMutableContextFromRoot(root)
        self._drawn = self._plant.CreateDefaultContext()  # for poses: a running simulation keeps its own
        self._scene_graph, self._scene_context = scene_graph, scene_graph.GetMyContextFromRoot(root)
        self._joints = np.array([self._plant.GetJointByName(n).position_start() for n in JOINT_NAMES])
        self._object = self._plant.GetBodyByName(self.bodies.object)
        self._tool = self._plant.GetBodyByName(self.bodies.tool)
        self._seen = tuple(sorted({v.body for v in self.visuals} - {"world"}))

    def reset(self, q_rad: Array, X_BO: Array) -> None:
        """Arm at rest at `q_rad`, object at rest at `X_BO`, everything else as built."""
        self.positions = self._with_arm(self._plant.GetDefaultPositions(), q_rad)
        self._set_object(X_BO)

    @property
    def positions(self) -> Array:
        """(nq,) positions of the whole plant."""
        return np.array(self._plant.GetPositions(self._context))

    @positions.setter
    def positions(self, value: Array) -> None:
        self._plant.SetPositions(self._context, value)
        self._plant.SetVelocities(self._context, np.zeros(self._plant.num_velocities()))

    @property
    def q_rad(self) -> Array:
        """(7,) true joint positions."""
        return np.asarray(self.positions[self._joints])

    @property
    def X_BO(self) -> Array:
        """(4, 4) the object in the world."""
        return np.asarray(self._plant.EvalBodyPoseInWorld(self._context, self._object).GetAsMatrix4())

    def simulate(
        self, t_s: Array, q_rad: Array, so_far: Callable[[PlantMotion], object] = lambda _: None
    ) -> PlantMotion:
        """Follow the joint path (N,), (N, 7), then hold its end until the object rests, at most `SETTLE_S`.

        Calls `so_far` every `PIECE_S` with the motion until then. Raises DivergedError.
        """
        self._reference.UpdateTrajectory(PiecewisePolynomial.FirstOrderHold(t_s, q_rad.T))
        root = self._simulator.get_mutable_context()
        root.SetTime(0.0)
        self.positions = self.positions
        log = self._log.FindMutableLog(root)
        log.Clear()
        self._simulator.Initialize()
        end_s, last_s = float(t_s[-1]) + SETTLE_MIN_S, float(t_s[-1]) + SETTLE_S
        for until_s in (*np.arange(PIECE_S, end_s, PIECE_S), end_s):
            so_far(self._advanced(until_s, log))
        while not self._rests(log) and end_s < last_s:
            end_s = min(end_s + PIECE_S, last_s)
            so_far(self._advanced(end_s, log))
        motion = self._motion(log)
        self.positions = motion.positions[-1]
        return motion

    def travel(self, t_s: Array, q_rad: Array) -> PlantMotion:
        """Follow `q_rad` (M, 7) at `t_s` (M,) exactly, while the object lies still."""
        rows = np.empty((len(t_s), self._plant.num_positions()))
        for row, q in zip(rows, q_rad, strict=True):
            self.positions = self._with_arm(self.positions, q)
            row[:] = self.positions
        return PlantMotion(t_s, rows, rows[:, self._joints])

    def touches(self) -> tuple[bool, bool]:
        """(whether the object touches the tool, whether it touches anything else)."""
        query: QueryObject = self._scene_graph.get_query_output_port().Eval(self._scene_context)
        inspector = query.inspector()
        representation = self._plant.get_contact_surface_representation()
        surfaces, points = query.ComputeContactSurfacesWithFallback(representation)
        pairs = [(s.id_M(), s.id_N()) for s in surfaces] + [(p.id_A, p.id_B) for p in points]
        names = [{self._plant.GetBodyFromFrameId(inspector.GetFrameId(g)).index() for g in pair} for pair in pairs]
        others = [pair - {self._object.index()} for pair in names if self._object.index() in pair]
        tool = {self._tool.index()}
        return any(o == tool for o in others), any(o != tool for o in others)

    def would_touch(self, q_rad: Array) -> bool:
        """Whether the tool meets the object at its present place anywhere on `q_rad` (M, 7).

        Does not change the state.
        """
        before = self.positions
        try:
            for q in q_rad:
                self.positions = self._with_arm(before, q)
                if self.touches()[0]:
                    return True
            return False
        finally:
            self.positions = before

    def poses(self, positions: Array) -> Mapping[str, Array]:
        """(S, nq) -> poses (S, 4, 4) in the base frame of all visible bodies, by name."""
        bodies = [self._plant.GetBodyByName(name) for name in self._seen]
        poses = {name: np.empty((len(positions), 4, 4)) for name in self._seen}
        for i, row in enumerate(positions):
            self._plant.SetPositions(self._drawn, row)
            for name, body in zip(self._seen, bodies, strict=True):
                poses[name][i] = self._plant.EvalBodyPoseInWorld(self._drawn, body).GetAsMatrix4()
        return poses

    def _set_object(self, X_BO: Array) -> None:
        self._plant.SetFreeBodyPose(self._context, self._object, RigidTransform(X_BO))

    def _advanced(self, until_s: float, log: Any) -> PlantMotion:
        """The motion until then. Raises DivergedError."""
        try:
            self._simulator.AdvanceTo(until_s)
        except RuntimeError as error:
            raise DivergedError(self._simulator.get_context().get_time(), str(error), self._motion(log)) from error
        return self._motion(log)

    def _rests(self, log: Any) -> bool:
        """Whether the object has been slow for the time that a trial requires. The tool rests meanwhile."""
        first = self._plant.num_positions() + self._object.floating_velocities_start_in_v()
        times_s = log.sample_times()
        w_rad_s, v_m_s = np.split(log.data()[first : first + 6, times_s >= times_s[-1] - REST_S], 2)
        return bool(
            np.linalg.norm(v_m_s, axis=0).max() < REST_M_S and np.linalg.norm(w_rad_s, axis=0).max() < REST_RAD_S
        )

    def _with_arm(self, positions: Array, q_rad: Array) -> Array:
        full = np.array(positions)
        full[self._joints] = q_rad
        return full

    def _motion(self, log: Any) -> PlantMotion:
        positions = np.array(log.data()[: self._plant.num_positions()].T)
        return PlantMotion(np.array(log.sample_times()), positions, positions[:, self._joints])


def make_position_controlled(plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
    """Add springs and dampers in the joints. They pull the arm along the input of its port for the desired state."""
    for name, p, d in zip(JOINT_NAMES, STIFFNESS_NM_RAD, DAMPING_NMS_RAD, strict=True):
        plant.GetJointActuatorByName(name, arm).set_controller_gains(PdControllerGains(p=p, d=d))
    plant.set_gravity_enabled(arm, False)  # the controller carries the arm's weight


def hold(q_rad: Array) -> PiecewisePolynomial:
    """A trajectory that stays at `q_rad` (7,)."""
    held: PiecewisePolynomial = PiecewisePolynomial.ZeroOrderHold([0.0, 1.0], np.column_stack([q_rad, q_rad]))
    return held
