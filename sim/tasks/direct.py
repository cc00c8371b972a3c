"""A rollout without an arm: the tool driven directly by a carriage, the poses read every 20 ms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from pydrake.systems.primitives import TrajectorySource

from hw.types import Array
from sim.tasks.carriage import CARRIAGE, Drive, add_carriage, place_carriage
from sim.tasks.contact import keep_apart
from sim.tasks.task import SceneBodies

READ_EVERY_S = 0.020


@dataclass(frozen=True, eq=False)
class Start:
    """Where a rollout begins; what happens before is left out."""

    t_s: float
    X_BO: Array  # (4, 4) the object at rest
    tool: Array  # (6,) the carriage: forward, up, pitch and their rates


@dataclass(frozen=True, eq=False)
class Moment:
    """Tool and object at a reading."""

    t_s: float
    object: RigidBody
    tool: RigidBody
    state: Context


@dataclass(frozen=True, eq=False)
class Readings:
    """What a rollout went through."""

    t_s: Array  # (N,) every 20 ms
    X_BO: tuple[RigidTransform, ...]
    X_BT: tuple[RigidTransform, ...]
    failure: str | None  # why the solver gave up

    @property
    def p_BO_m(self) -> Array:
        """(N, 3)"""
        return np.array([X.translation() for X in self.X_BO])

    @property
    def p_TO_m(self) -> Array:
        """(3,) the object in the tool frame at the end."""
        return np.asarray(self.X_BT[-1].inverse() @ self.X_BO[-1].translation())


def reading_before_s(t_s: float) -> float:
    """The last moment on the grid of readings that is not after `t_s`, nor before 0."""
    return max(0.0, math.floor(t_s / READ_EVERY_S) * READ_EVERY_S)


def run(
    drive: Drive,
    build: Callable[[MultibodyPlant, Frame], SceneBodies],
    dt_s: float,
    start: Start,
    end_s: float,
    finished: Callable[[Moment], bool],
) -> Readings:
    """Step the scene that `build` adds, from `start` to `end_s` or until it has `finished`. Never raises for a solver
    that does not converge."""
    robot = RobotDiagramBuilder(time_step=dt_s)  # a plain DiagramBuilder leaks some 150 KB a rollout in pydrake
    builder, plant = robot.builder(), robot.plant()
    plant.SetUseSampledOutputPorts(False)  # nobody reads what they would keep
    bodies = build(plant, add_carriage(plant, drive))
    keep_apart(robot.scene_graph(), bodies.apart)
    plant.Finalize()
    source = builder.AddSystem(TrajectorySource(drive.trajectory))
    port = plant.get_desired_state_input_port(plant.GetModelInstanceByName(CARRIAGE))
    builder.Connect(source.get_output_port(), port)
    simulator = Simulator(robot.Build())
    simulator.get_mutable_context().SetTime(start.t_s - dt_s / 2)  # see _read
    state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(state, plant.GetBodyByName(bodies.object), RigidTransform(start.X_BO))
    place_carriage(plant, state, start.tool)
    return _read(simulator, plant, bodies, start.t_s, end_s, finished, dt_s)


def _read(
    simulator: Simulator,
    plant: MultibodyPlant,
    bodies: SceneBodies,
    start_s: float,
    end_s: float,
    finished: Callable[[Moment], bool],
    dt_s: float,
) -> Readings:
    """A step taken at t brings the state of t + dt. The clock runs half a step early, so that rounding never decides
    whether the step at a reading has been taken."""
    state = plant.GetMyContextFromRoot(simulator.get_context())
    body, tool = plant.GetBodyByName(bodies.object), plant.GetBodyByName(bodies.tool)
    t_s = [start_s]
    X_BO = [body.EvalPoseInWorld(state)]
    X_BT = [tool.EvalPoseInWorld(state)]
    failure = None
    try:
        simulator.Initialize()
        while t_s[-1] < end_s and not finished(Moment(t_s[-1], body, tool, state)):
            t = min(start_s + len(t_s) * READ_EVERY_S, end_s)
            simulator.AdvanceTo(t - dt_s / 2)
            t_s.append(t)
            X_BO.append(body.EvalPoseInWorld(state))
            X_BT.append(tool.EvalPoseInWorld(state))
    except RuntimeError as error:  # what Drake's solvers raise
        failure = f"the solver failed after {t_s[-1]:.2f} s: {error}"
    return Readings(np.array(t_s), tuple(X_BO), tuple(X_BT), failure)
