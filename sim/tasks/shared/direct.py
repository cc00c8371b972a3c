"""A rollout without an arm, in Drake: a carriage drives the tool directly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from pydrake.systems.primitives import TrajectorySource

from sim.tasks.shared.carriage import CARRIAGE, add_carriage, place_carriage
from sim.tasks.shared.contact import keep_apart
from sim.tasks.shared.readings import Course, Readings, is_slow, read
from sim.tasks.task import SceneBodies


@dataclass(frozen=True, eq=False)
class _Moment:
    t_s: float
    object: RigidBody
    tool: RigidBody
    state: Context

    @property
    def X_BO(self) -> RigidTransform:
        X: RigidTransform = self.object.EvalPoseInWorld(self.state)
        return X

    @property
    def X_BT(self) -> RigidTransform:
        X: RigidTransform = self.tool.EvalPoseInWorld(self.state)
        return X

    @property
    def is_still_on_table(self) -> bool:
        V_BO = self.object.EvalSpatialVelocityInWorld(self.state)
        return is_slow(V_BO.translational(), V_BO.rotational())

    @property
    def is_still_on_tool(self) -> bool:
        V_BO, V_BT = (body.EvalSpatialVelocityInWorld(self.state) for body in (self.object, self.tool))
        X_BO, X_BT = (body.EvalPoseInWorld(self.state) for body in (self.object, self.tool))
        p_TO_B = X_BO.translation() - X_BT.translation()
        carried = V_BT.Shift(p_TO_B)
        return is_slow(V_BO.translational() - carried.translational(), V_BO.rotational() - carried.rotational())


def run(course: Course, build: Callable[[MultibodyPlant, Frame], SceneBodies], dt_s: float) -> Readings:
    """Step the scene that `build` adds through the course. Never raises for a solver that does not converge."""
    return read(Stepped.at_start(course, build, dt_s), course)


class Stepped:
    """Drake, as `Physics`.

    A step taken at t brings the state of t + dt. The clock runs half a step early, so that rounding never decides
    whether the step at a reading has been taken.
    """

    def __init__(self, simulator: Simulator, plant: MultibodyPlant, bodies: SceneBodies, dt_s: float) -> None:
        self.simulator, self.plant, self._dt_s = simulator, plant, dt_s
        self._state = plant.GetMyContextFromRoot(simulator.get_context())
        self._object, self._tool = (plant.GetBodyByName(name) for name in (bodies.object, bodies.tool))

    @classmethod
    def at_start(cls, course: Course, build: Callable[[MultibodyPlant, Frame], SceneBodies], dt_s: float) -> Stepped:
        """The scene that `build` adds, at the start of the course.

        With `dt_s` 0 the caller has to choose an integrator.
        """
        robot = RobotDiagramBuilder(time_step=dt_s)  # a plain DiagramBuilder leaks some 150 KB a rollout in pydrake
        builder, plant, start = robot.builder(), robot.plant(), course.start
        plant.SetUseSampledOutputPorts(False)  # nobody reads the ports that would be cached
        bodies = build(plant, add_carriage(plant, course.drive))
        keep_apart(robot.scene_graph(), bodies.apart)
        plant.Finalize()
        source = builder.AddSystem(TrajectorySource(course.drive.trajectory))
        port = plant.get_desired_state_input_port(plant.GetModelInstanceByName(CARRIAGE))
        builder.Connect(source.get_output_port(), port)
        simulator = Simulator(robot.Build())
        simulator.get_mutable_context().SetTime(start.t_s - dt_s / 2)
        state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        plant.SetFreeBodyPose(state, plant.GetBodyByName(bodies.object), RigidTransform(start.X_BO))
        place_carriage(plant, state, start.tool)
        return cls(simulator, plant, bodies, dt_s)

    def now(self, t_s: float) -> _Moment:
        """See `Physics`."""
        return _Moment(t_s, self._object, self._tool, self._state)

    def advance_to(self, t_s: float) -> None:
        """See `Physics`."""
        self.simulator.AdvanceTo(t_s - self._dt_s / 2)
