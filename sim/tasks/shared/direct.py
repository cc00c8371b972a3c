"""A task's scene in Drake without an arm: rollouts, in which a carriage drives the tool, and the tool's mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource

from hw.types import Array
from sim.tasks.hardware import BuildScene
from sim.tasks.shared.carriage import CARRIAGE, add_carriage, place_carriage
from sim.tasks.shared.contact import keep_apart
from sim.tasks.shared.readings import Course, Moment, Velocity
from sim.tasks.task import Task
from sim.types import merged


class Drake:
    """A scene at the start of a course, as `sim.tasks.shared.readings.Physics`.

    A step taken at t brings the state of t + dt. The clock runs half a step early, so that rounding never decides
    whether the step at a reading has been taken.
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


def tool_mesh(task: Task) -> tuple[Array, NDArray[np.int32]]:
    """(vertices (V, 3) in the tool frame T in m, triangles (F, 3)) of the tool as designed, unbent.

    Raises NoHardware.
    """
    hardware = task.require_hardware()
    config = MultibodyPlantConfig(time_step=hardware.time_step_s(None), use_sampled_output_ports=False)
    plant, _ = AddMultibodyPlant(config, DiagramBuilder())
    parameters = task.parameters.middle
    nuisance = task.nuisance.middle
    bodies = hardware.build_scene(plant, plant.world_frame(), np.eye(4), parameters, nuisance, None)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    X_TW = plant.GetBodyByName(bodies.tool).EvalPoseInWorld(context).inverse()
    parts = []
    for visual in bodies.visuals:
        if visual.body not in ("world", bodies.object):
            X_TV = (X_TW @ plant.GetBodyByName(visual.body).EvalPoseInWorld(context)).GetAsMatrix4()
            parts.append((visual.vertices_m @ X_TV[:3, :3].T + X_TV[:3, 3], visual.triangles))
    return merged(parts)
