"""Worlds drawn by a rule instead of chosen: parameters in Omega or its margin, and unmodelled effects."""

from __future__ import annotations

import json
from collections.abc import Collection
from typing import Any

import numpy as np

from sim.lab.world import Faults, Sensing, World
from sim.tasks.task import Task
from sim.types import Dimension

_SAMPLED = 4096  # the first is used; the draws after them, and so the known worlds, depend on their number


def drawn_world(task: Task, seed: int, number: int) -> World:
    """World `number` of `seed`, always the same."""
    return draw_world(task, np.random.default_rng((seed, number)), name=f"drawn-{seed}-{number}")


def draw_world(
    task: Task,
    rng: np.random.Generator,
    *,
    effects: Collection[str] | None = None,
    name: str = "drawn",
) -> World:
    """Draw a world: parameters from Omega with probability 1/2, else from the margin; each plausible effect with
    probability 1/2.

    `effects` names the only effects that may be present.
    """
    space = task.parameters if rng.random() < 0.5 else task.margin
    parameters = space.sample(rng, _SAMPLED)
    present: dict[str, Any] = {}
    for effect, (low, high) in task.plausible.items():
        if rng.random() < 0.5 or (effects is not None and effect not in effects):
            continue
        value = high if isinstance(low, str) else np.round(rng.uniform(low, high), 4).tolist()
        present[effect] = tuple(value) if isinstance(value, list) else value
    nuisance = task.nuisance.sample(rng, 1)[0]
    return World(name, task.name, "", parameters[0], nuisance, task.unmodelled(**present), Sensing(), Faults())


def effects_of(task: Task, world: World) -> dict[str, Any]:
    """The unmodelled effects that a world has, by name."""
    nominal = vars(task.unmodelled())
    return {name: value for name, value in vars(world.unmodelled).items() if value != nominal[name]}


def as_toml(task: Task, world: World) -> str:
    """A world as the text of its file: physics, parameters, nuisance and effects, without a description."""
    lines = [f'task = "{task.name}"', 'description = ""']
    lines += [] if world.physics == "drake" else [f'physics = "{world.physics}"']
    lines += ["", "[params]"]
    lines += [_line(d, v) for d, v in zip(task.parameters.dimensions, world.parameters, strict=True)]
    lines += ["", "[nuisance]"]
    lines += [_line(d, v) for d, v in zip(task.nuisance.dimensions, world.nuisance, strict=True)]
    lines += ["", "[unmodelled]"]
    lines += [f"{name} = {json.dumps(value)}" for name, value in effects_of(task, world).items()]
    return "\n".join(lines) + "\n"


def _line(dimension: Dimension, value: float) -> str:
    return f"{dimension.name} = {value:.0f}" if dimension.scale == "integer" else f"{dimension.name} = {value:.4g}"
