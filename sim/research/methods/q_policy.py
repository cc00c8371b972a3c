"""The paper's AdaptSim: an adaptation policy moves every particle by its last trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.types import Array, frozen_array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.errors import CheckpointError
from sim.research.methods.memory import MemoryName, encode, networks_of, seen_in_session
from sim.research.methods.q_network import QNetwork
from sim.rollouts.draws import cover
from sim.tasks.task import Task


def create_iteration(task: Task, checkpoint: Checkpoint | None) -> QPolicy:
    """AdaptSim as in the paper: a particle moves by its last iteration. Raises CheckpointError."""
    return _with(task, checkpoint, "iteration")


def create_state(task: Task, checkpoint: Checkpoint | None) -> QPolicy:
    """AdaptSim-State of the paper: it sees only the ends of the last trials. Raises CheckpointError."""
    return _with(task, checkpoint, "state")


def create_history(task: Task, checkpoint: Checkpoint | None) -> QPolicy:
    """AdaptSim that sees all parameters, trajectories and rewards of the session. Raises CheckpointError."""
    return _with(task, checkpoint, "history")


def _with(task: Task, checkpoint: Checkpoint | None, memory: MemoryName) -> QPolicy:
    if checkpoint is None:
        raise CheckpointError(f"adaptsim needs a checkpoint: make one with `adaptsim pretrain --task {task.name}`")
    networks = networks_of(checkpoint)
    if memory not in networks:
        raise CheckpointError(
            f"{checkpoint.path} holds no adaptation policy that sees the {memory}: pretrain with "
            f"`adaptsim pretrain --task {task.name} --methods`"
        )
    return QPolicy(task, networks[memory], memory)


@dataclass(frozen=True, eq=False)
class QPolicy:
    """A `Method`: the adaptation policy, applied to each particle."""

    task: Task
    network: QNetwork
    memory: MemoryName = "iteration"

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """Means spread over Omega: random, but far from each other."""
        return tuple(Particle(mean[None]) for mean in cover(self.task.parameters, n, rng))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Deterministic. A particle without trials in the last iteration stays."""
        return tuple(
            Particle(self._moved(history, i)[None]) if seen.trials else seen.particle
            for i, seen in enumerate(history[-1])
        )

    def _moved(self, history: Sequence[Iteration], particle: int) -> Array:
        """(p,) the new mean of a particle, in units."""
        task, mean = self.task, history[-1][particle].particle.mean
        state = encode(task, self.memory, seen_in_session(task, history, particle))
        return frozen_array(task.parameters.step(mean, self.network.directions(state)[0], task.adaptation.delta))
