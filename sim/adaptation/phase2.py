"""AdaptSim on the real target: every particle moves by what its last trials showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.adaptation.method import Iteration, Particle
from sim.adaptation.q_network import QNetwork
from sim.adaptation.step import adapt
from sim.errors import CheckpointError
from sim.sampling import sobol, spread
from sim.tasks.task import Task

if TYPE_CHECKING:
    from sim.checkpoint import Checkpoint


def create(task: Task, checkpoint: Checkpoint | None) -> AdaptSim:
    """The method's entry in `sim.adaptation.METHODS`. Raises CheckpointError when there is no checkpoint."""
    if checkpoint is None:
        raise CheckpointError(f"adaptsim needs a checkpoint: make one with `adaptsim pretrain --task {task.name}`")
    return AdaptSim(task, checkpoint.q_network)


@dataclass(frozen=True, eq=False)
class AdaptSim:
    """A `Method`: the adaptation policy, applied to each particle on its own."""

    task: Task
    network: QNetwork

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """Means spread over Omega: random, but far from each other."""
        means = spread(self.task.parameters, sobol(n, len(self.task.parameters), rng))
        return tuple(Particle(mean[None]) for mean in means)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Deterministic. A particle without trials in the last iteration stays."""
        return tuple(
            Particle(adapt(self.network, self.task, seen.particle.mean, [t.observation for t in seen.trials])[None])
            if seen.trials
            else seen.particle
            for seen in history[-1]
        )
