"""Random best-of-n: particles that fill Omega evenly, independent of the trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.rollouts.draws import cover
from sim.tasks.task import Task

CANDIDATES = 256


def create(task: Task, checkpoint: Checkpoint | None) -> RandomSearch:
    """The method's entry in `METHODS`; it needs no checkpoint."""
    return RandomSearch(task)


@dataclass(frozen=True, eq=False)
class RandomSearch:
    """A `Method`: each next particle is the random candidate farthest from all tried ones."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first is random; each other one is far from those before it."""
        return self._farthest(np.zeros((0, len(self.task.parameters))), n, rng)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Particles far from all tried ones, whatever those earned."""
        tried = np.array([seen.particle.mean for iteration in history for seen in iteration])
        return self._farthest(self.task.parameters.normalise(tried), len(history[-1]), rng)

    def _farthest(self, tried: Array, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        space = self.task.parameters
        means = cover(space, CANDIDATES, rng)
        unit = space.normalise(means)
        chosen: list[Particle] = []
        for _ in range(n):
            gaps = np.linalg.norm(unit[:, None] - tried[None], axis=-1).min(axis=1, initial=np.inf)
            pick = int(np.argmax(gaps)) if len(tried) else 0
            chosen.append(Particle(means[pick][None]))
            tried = np.concatenate([tried, unit[pick][None]])
        return tuple(chosen)
