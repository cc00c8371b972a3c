"""Uniform domain randomisation: one task policy for all of Omega, and nothing is adapted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.adaptation.method import Iteration, Particle
from sim.sampling import sobol, spread
from sim.tasks.task import Task

if TYPE_CHECKING:
    from sim.checkpoint import Checkpoint

SAMPLES = 64
"""Parameters that stand for all of Omega."""


def create(task: Task, checkpoint: Checkpoint | None) -> Udr:
    """The method's entry in `sim.adaptation.METHODS`; it needs no checkpoint."""
    return Udr(task)


@dataclass(frozen=True, eq=False)
class Udr:
    """A `Method` whose particles never change."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """`n` particles, each over all of Omega."""
        dimensions = len(self.task.parameters)
        return tuple(Particle(spread(self.task.parameters, sobol(SAMPLES, dimensions, rng))) for _ in range(n))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        return tuple(seen.particle for seen in history[-1])
