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
from perception.types import REST_M_S, REST_RAD_S, REST_S
from sim.tasks.shared.carriage import CARRIAGE, Drive, add_carriage, place_carriage
from sim.tasks.shared.contact import keep_apart
from sim.tasks.task import SceneBodies

READ_EVERY_S = 0.020
_STILL_READINGS = round(REST_S / READ_EVERY_S) + 1
"""So many in a row span `REST_S`. One alone is no rest: what rolls to and fro stands still where it turns."""


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

    @property
    def X_BO(self) -> RigidTransform:
        X: RigidTransform = self.object.EvalPoseInWorld(self.state)
        return X

    @property
    def p_TO_m(self) -> Array:
        """(3,) the object in the tool frame."""
        return np.asarray(self.tool.EvalPoseInWorld(self.state).inverse() @ self.X_BO.translation())

    @property
    def is_still_on_table(self) -> bool:
        """Whether the object is as slow as at rest."""
        V_BO = self.object.EvalSpatialVelocityInWorld(self.state)
        return _is_slow(V_BO.translational(), V_BO.rotational())

    @property
    def is_still_on_tool(self) -> bool:
        """Whether it is as slow as at rest against the tool."""
        V_BO, V_BT = (body.EvalSpatialVelocityInWorld(self.state) for body in (self.object, self.tool))
        p_TO_B = self.X_BO.translation() - self.tool.EvalPoseInWorld(self.state).translation()
        carried = V_BT.Shift(p_TO_B)
        return _is_slow(V_BO.translational() - carried.translational(), V_BO.rotational() - carried.rotational())


@dataclass(frozen=True)
class Ending:
    """When a rollout is over."""

    still: Callable[[Moment], bool]
    """Whether the object is still where nothing moves it any more; it rests once it has been for `REST_S`."""
    decided: Callable[[Moment], bool]
    """Whether nothing that comes can change how it is judged."""
    latest_s: float


@dataclass(frozen=True, eq=False)
class Readings:
    """What a rollout went through."""

    t_s: Array  # (N,) every 20 ms
    X_BO: tuple[RigidTransform, ...]
    X_BT: tuple[RigidTransform, ...]
    is_settled: bool  # whether it came to its end before the latest moment
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
    ending: Ending,
) -> Readings:
    """Step the scene that `build` adds, from `start` to its `ending`. Never raises for a solver that does not
    converge."""
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
    return _read(simulator, plant, bodies, start.t_s, ending, dt_s)


def _read(
    simulator: Simulator,
    plant: MultibodyPlant,
    bodies: SceneBodies,
    start_s: float,
    ending: Ending,
    dt_s: float,
) -> Readings:
    """A step taken at t brings the state of t + dt. The clock runs half a step early, so that rounding never decides
    whether the step at a reading has been taken."""
    state = plant.GetMyContextFromRoot(simulator.get_context())
    body, tool = plant.GetBodyByName(bodies.object), plant.GetBodyByName(bodies.tool)
    t_s = [start_s]
    X_BO = [body.EvalPoseInWorld(state)]
    X_BT = [tool.EvalPoseInWorld(state)]
    failure, still = None, 0
    try:
        simulator.Initialize()
        while t_s[-1] < ending.latest_s:
            now = Moment(t_s[-1], body, tool, state)
            still = still + 1 if ending.still(now) else 0
            if still == _STILL_READINGS or ending.decided(now):
                break
            t = min(start_s + len(t_s) * READ_EVERY_S, ending.latest_s)
            simulator.AdvanceTo(t - dt_s / 2)
            t_s.append(t)
            X_BO.append(body.EvalPoseInWorld(state))
            X_BT.append(tool.EvalPoseInWorld(state))
    except RuntimeError as error:  # what Drake's solvers raise
        failure = f"the solver failed after {t_s[-1]:.2f} s: {error}"
    return Readings(np.array(t_s), tuple(X_BO), tuple(X_BT), failure is None and t_s[-1] < ending.latest_s, failure)


def _is_slow(v_m_s: Array, w_rad_s: Array) -> bool:
    return bool(np.linalg.norm(v_m_s) < REST_M_S) and bool(np.linalg.norm(w_rad_s) < REST_RAD_S)
