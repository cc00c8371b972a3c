"""Rollouts in a world: the tool driven directly in the physics of the world, without arm and camera."""

from __future__ import annotations

from functools import partial
from typing import Any

from hw.types import Array
from perception.types import ObjectTrack
from sim.lab.world import World
from sim.tasks import get_task
from sim.tasks.task import Simulate


def rollouts_in(world: World) -> Simulate:
    """A `Task.simulate` of which only context and action count: parameters, nuisance and effects are the world's.

    It can be sent to another process.
    """
    return partial(_simulate, world)


def _simulate(
    world: World, parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None
) -> ObjectTrack:
    return get_task(world.task).simulate(world.parameters, context, action, world.nuisance, world.unmodelled)
