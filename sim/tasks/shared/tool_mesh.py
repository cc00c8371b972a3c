"""The mesh of a task's tool, from its scene in Drake."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from hw.types import Array
from sim.tasks.task import Task
from sim.types import merged


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
