"""A picture of a task's object and tool before a trial, close by; no arm, no noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from hw.types import Array
from sim.lab.kinect import kinect_model
from sim.render.renderer import WORLD, Renderer
from sim.tasks.task import Task

FROM_M = np.array([0.22, -0.30, 0.26])
"""The camera from the object: ahead, to the right, above."""


def still(task: Task) -> NDArray[np.uint8]:
    """(720, 1280, 3) RGB at the reference context, all parameters in the middle of their ranges. Raises NoHardware."""
    hardware = task.require_hardware()
    parameters, nuisance, action = (
        space.denormalise(np.full(len(space), 0.5)) for space in (task.parameters, task.nuisance, task.action)
    )
    start = hardware.plan(task.reference_context, action).X_BT[0]
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), hardware.time_step_s(None))
    bodies = hardware.build_scene(plant, plant.world_frame(), start, parameters, nuisance, None)
    plant.Finalize()
    state = plant.CreateDefaultContext()
    X_BO = hardware.rest_pose(task.reference_context, parameters, nuisance, None)
    plant.SetFreeBodyPose(state, plant.GetBodyByName(bodies.object), RigidTransform(X_BO))
    names = {visual.body for visual in bodies.visuals} - {WORLD}
    poses = {name: plant.GetBodyByName(name).EvalPoseInWorld(state).GetAsMatrix4()[None] for name in names}
    renderer = Renderer(kinect_model(), _looking_at(X_BO[:3, 3]), bodies.visuals)
    return renderer.render(poses, None, np.random.default_rng(0))[0]


def _looking_at(p_B_m: Array) -> Array:
    """(4, 4) an upright camera: Z forward, X to the right."""
    forward = -FROM_M / np.linalg.norm(FROM_M)
    right = np.cross(forward, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(forward, [0.0, 0.0, 1.0]))
    X_BC = np.eye(4)
    X_BC[:3, :3], X_BC[:3, 3] = np.column_stack([right, np.cross(forward, right), forward]), p_B_m + FROM_M
    return X_BC
