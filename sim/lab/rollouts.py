"""Rollouts in a world: the tool driven directly in the physics of the world, without arm and camera."""

from __future__ import annotations

from functools import partial
from typing import Any

from hw.types import Array
from perception.types import ObjectTrack
from sim.lab.physics import simulate_of
from sim.lab.world import World
from sim.tasks.task import Simulate


def rollouts_in(world: World) -> Simulate:
    """A `Task.simulate` that uses only context and action: parameters, nuisance and effects are the world's.

    It can be sent to another process. A call raises ExtraMissing if the world's physics is not installed.
    """
    return partial(_simulate, world)


def _simulate(
    world: World, parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None
) -> ObjectTrack:
    there = simulate_of(world.task, world.physics)
    return there(world.parameters, context, action, world.nuisance, world.unmodelled)
