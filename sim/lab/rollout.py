"""Rollouts in a world. Parameters, nuisance and unmodelled effects are the world's; the caller gives contexts and
actions.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import simulating
from sim.lab.physics import simulate_of
from sim.lab.world import World
from sim.tasks.library import library_of
from sim.tasks.task import Task


def rollout_in(world: World, context: Array, action: Array, task: Task | None = None) -> ObjectTrack:
    """A rollout at a context (c,) by an action (a,): parameters, nuisance and effects are the world's.

    `task` is that of the checkpoint, which contains the trained policies if there are any. Raises ExtraMissing if the
    world's physics is not installed, RolloutError if the task's code fails.
    """
    simulate = simulate_of(world.task, world.physics) if task is None or library_of(task) is None else task.simulate
    with simulating(world.task, f"world {world.name}, action {np.asarray(action).tolist()}"):
        return simulate(world.parameters, context, action, world.nuisance, world.unmodelled)


def task_in(world: World, task: Task) -> Task:
    """The task, with the rollouts of this world. They run one by one, because batched rollouts lack the world's
    effects.
    """
    simulate = partial(_simulate_in, world, None if library_of(task) is None else task)
    return replace(task, simulate=simulate, simulate_many=None)


def _simulate_in(
    world: World, task: Task | None, parameters: Array, context: Array, action: Array, *disturbances: Any
) -> ObjectTrack:
    """A `Simulate` that can be sent to another process; only context and action count."""
    return rollout_in(world, context, action, task)
