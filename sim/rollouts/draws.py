"""Random draws over spaces, and the random parts of trials: the same numbers for the same seed on every machine."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.rollouts.run import Requests
from sim.tasks.task import Task
from sim.types import Space


def sobol(n: int, dimensions: int, rng: np.random.Generator) -> Array:
    """(n, dimensions) scrambled Sobol points in [0, 1); with the same generator state, a larger n extends a smaller
    one.
    """
    if dimensions == 0:
        return np.zeros((n, 0))
    from scipy.stats import qmc  # noqa: PLC0415 - slow to import, and commands that only list or read need no draws

    engine = qmc.Sobol(dimensions, scramble=True, rng=rng)
    return np.asarray(engine.random_base2(max(0, math.ceil(math.log2(max(n, 1)))))[:n], dtype=np.float64)


def cover(space: Space, n: int, rng: np.random.Generator) -> Array:
    """(n, len(space)) points in units that fill the space evenly."""
    return space.spread(sobol(n, len(space), rng))


def varies(task: Task) -> bool:
    """Whether two trials of the same action may differ."""
    return bool(len(task.nuisance)) or bool(np.any(task.action_noise))


def repeats_exactly(task: Task) -> bool:
    """Whether nothing in a task is drawn: neither contexts nor disturbances nor noise of observation."""
    return not (len(task.context) or varies(task) or np.any(task.observation.noise_std))


@dataclass(frozen=True, eq=False)
class Disturbances:
    """The random parts of N trials: action error and nuisance."""

    error: Array  # (N, a) in units, added to the commanded action
    nuisance: Array  # (N, n) in units

    @classmethod
    def from_unit(cls, task: Task, unit: Array) -> Disturbances:
        """The draws at points (N, a + n) of the unit box: the error's columns first."""
        a = len(task.action)
        return cls((2.0 * unit[:, :a] - 1.0) * task.action_noise, task.nuisance.spread(unit[:, a:]))

    @classmethod
    def evenly(cls, task: Task, n: int, rng: np.random.Generator) -> Disturbances:
        """`n` disturbances that fill their space evenly, for averages."""
        return cls.from_unit(task, sobol(n, len(task.action) + len(task.nuisance), rng))

    @classmethod
    def at_random(cls, task: Task, n: int, rng: np.random.Generator) -> Disturbances:
        """`n` independent disturbances, as in real trials."""
        error = rng.random((n, len(task.action)))
        return cls.from_unit(task, np.concatenate([error, rng.random((n, len(task.nuisance)))], axis=1))


def trial_requests(task: Task, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator) -> Requests:
    """Requests as a target executes them: commanded actions (N, a) with random error and nuisance."""
    drawn = Disturbances.at_random(task, len(actions), rng)
    return Requests(targets, contexts, actions + drawn.error, drawn.nuisance)


def physical_contexts(task: Task, unit: Array) -> Array:
    """Points (N, len(task.physical_context)) of the unit box -> the contexts (N, c) of rollouts for learning.

    They are drawn if a rollout depends on them; otherwise they are the reference context.
    """
    if len(task.physical_context):
        return task.context.spread(unit)
    return np.tile(np.asarray(task.reference_context, dtype=np.float64), (len(unit), 1))
