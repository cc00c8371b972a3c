"""CENIC, Drake's integrator with error control (Kurtz and Castro 2025), in place of the fixed steps of training.

`rollouts.py --cenic` measures it. It is not used anywhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from unittest.mock import patch

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, SimulatorConfig

from sim.tasks.shared.carriage import CARRIAGE
from sim.tasks.shared.direct import Stepped
from sim.tasks.shared.readings import Course, Readings, read
from sim.tasks.task import SceneBodies, Task

LONGEST_S = 0.010
"""The longest step that the integrator may choose."""

CARRIED_KG = 0.020
"""Mass of the two parts of the carriage that have none in training: CENIC refuses them so."""


@contextmanager
def stepping(task: Task, accuracy: float) -> Iterator[None]:
    """Rollouts of `task` in this process are stepped by CENIC."""
    rollout, scene = (import_module(f"sim.tasks.{task.name}.{part}") for part in ("rollout", "scene"))
    with patch.object(rollout, "run", partial(_run, accuracy)), patch.object(scene, "set_contact", _its_own):
        yield


def _run(
    accuracy: float, course: Course, build: Callable[[MultibodyPlant, Frame], SceneBodies], dt_s: float
) -> Readings:
    physics = Stepped.at_start(course, build, 0.0)
    simulator, plant = physics.simulator, physics.plant
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="cenic", accuracy=accuracy, max_step_size=LONGEST_S), simulator
    )
    state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for name in ("forward", "up"):
        part = plant.GetBodyByName(f"{CARRIAGE}_{name}")
        part.SetSpatialInertiaInBodyFrame(state, SpatialInertia.SolidSphereWithMass(CARRIED_KG, 0.02))
    return read(physics, course)


def _its_own(plant: MultibodyPlant, contact: str) -> None:
    """Its contact law is the lagged one; a plant without steps cannot be told."""
