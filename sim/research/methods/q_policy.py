"""The paper's AdaptSim: an adaptation policy moves every particle by its last trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle, require_whole
from sim.errors import CheckpointError
from sim.research.methods.q_network import QNetwork, new_network, restore_network
from sim.rollouts.draws import cover
from sim.storage.files import Tensors
from sim.tasks.task import Task

MemoryName = Literal["iteration", "state", "history"]

PREFIXES: dict[MemoryName, str] = {"iteration": "q_network.", "state": "q_state.", "history": "q_history."}
"""Prefix of an adaptation policy's tensors in a checkpoint, by memory."""

SLOTS = 20
"""Entries of a history: two particles over ten iterations."""


@dataclass(frozen=True, eq=False)
class PastIterations:
    """The pasts of B particles: S entries each; an entry is one iteration of one particle.

    Entry 0 is the particle's own last iteration. Then come its earlier ones, then those of the other particles, newest
    first. Missing entries are zero, with `age` below zero.
    """

    means: Array  # (B, S, p) in units
    observations: Array  # (B, S, T * size) normalised
    contexts: Array  # (B, S, T * c) normalised
    rewards: Array  # (B, S, T) of the trials
    own: Array  # (B, S) 1 for the particle's own entries
    age: Array  # (B, S) iterations ago; -1: no entry


def entries(task: Task) -> int:
    """Numbers in an entry of a history."""
    trial = task.observation.size + _goal(task) + 1
    return len(task.parameters) + task.adaptation.trials_per_iteration * trial + 2


def inputs(task: Task, memory: MemoryName) -> tuple[int, int]:
    """(slots, numbers in a slot) of the state of a policy with this memory."""
    if memory == "history":
        return SLOTS, entries(task) + 1
    size = _end(task) if memory == "state" else task.observation.size
    return 1, len(task.parameters) + task.adaptation.trials_per_iteration * (size + _goal(task))


def _end(task: Task) -> int:
    """The number of values at the end of an observation that describe the end of a trial."""
    return task.adaptation.end_moments * len(task.observation.columns)


def _goal(task: Task) -> int:
    """The number of values that describe the goal of a trial: those of its context, or 0 in a task without a goal."""
    return len(task.context) if task.goal_m else 0


def new_policy(task: Task, memory: MemoryName, seed: int) -> QNetwork:
    """An adaptation policy with this memory, freshly initialised from `seed` alone."""
    slots, width = inputs(task, memory)
    return new_network(width, len(task.parameters), seed, slots)


def restore_policy(task: Task, memory: MemoryName, tensors: Tensors) -> QNetwork:
    """An adaptation policy with this memory. Raises CheckpointError if the tensors do not fit."""
    slots, width = inputs(task, memory)
    return restore_network(width, len(task.parameters), tensors, slots)


def tensors_of(networks: Mapping[MemoryName, QNetwork]) -> dict[str, NDArray[Any]]:
    """The tensors of adaptation policies, for a checkpoint."""
    return {f"{PREFIXES[memory]}{name}": t for memory, net in networks.items() for name, t in net.tensors.items()}


def networks_of(checkpoint: Checkpoint) -> dict[MemoryName, QNetwork]:
    """The adaptation policies in a checkpoint, by memory. Raises CheckpointError if one does not fit."""
    parts = {memory: checkpoint.part(prefix) for memory, prefix in PREFIXES.items()}
    return {memory: restore_policy(checkpoint.solver.task, memory, part) for memory, part in parts.items() if part}


def encode(task: Task, memory: MemoryName, past: PastIterations) -> Array:
    """(B, slots * numbers): the network's input."""
    means = task.parameters.normalise(past.means)
    goals = past.contexts[..., : task.adaptation.trials_per_iteration * _goal(task)]
    if memory == "iteration":
        return np.concatenate([means[:, 0], past.observations[:, 0], goals[:, 0]], axis=-1)
    if memory == "state":
        trials = past.observations[:, 0].reshape(len(means), task.adaptation.trials_per_iteration, -1)
        ends = trials[..., -_end(task) :].reshape(len(means), -1)
        return np.concatenate([means[:, 0], ends, goals[:, 0]], axis=-1)
    filled = (past.age >= 0.0)[..., None]
    rest = [past.own[..., None], past.age[..., None] / 8.0, filled]
    full = np.where(filled, np.concatenate([means, past.observations, goals, past.rewards, *rest], axis=-1), 0.0)
    padded = np.zeros((len(full), SLOTS, full.shape[-1]))
    padded[:, : full.shape[1]] = full[:, :SLOTS]
    return padded.reshape(len(full), -1)


def look_back(means: Array, observations: Array, contexts: Array, rewards: Array) -> PastIterations:
    """The pasts of the particles in episodes (E, P, n, ...) of P particles with one target: (E * P, P * n, ...)."""
    episodes, particles, n = means.shape[:3]
    columns: list[list[Array]] = [[], [], [], []]
    for j in range(particles):
        order = [j, *(i for i in range(particles) if i != j)]
        for column, values in zip(columns, (means, observations, contexts, rewards), strict=True):
            newest_first = values[:, order, ::-1]
            column.append(newest_first.reshape(episodes, particles * n, -1))
    stacked = [np.stack(column, axis=1).reshape(episodes * particles, particles * n, -1) for column in columns]
    own = np.zeros((episodes * particles, particles * n))
    own[:, :n] = 1.0
    age = np.tile(np.arange(n, dtype=np.float64), (episodes * particles, particles))
    return PastIterations(stacked[0], stacked[1], stacked[2], stacked[3], own, age)


def seen_in_session(task: Task, history: Sequence[Iteration], particle: int) -> PastIterations:
    """The past of one particle of a session. Raises ValueError if it has no trial in the last iteration.

    If there are more than `trials_per_iteration` trials, only the last ones count; if there are fewer, they are
    repeated.
    """
    count, latest = task.adaptation.trials_per_iteration, len(history) - 1
    if not history or not history[-1][particle].trials:
        raise ValueError("adaptation needs at least one trial of this iteration")
    others = [i for i in range(len(history[-1])) if i != particle]
    rows = []
    for i in (particle, *others):
        for k in range(latest, -1, -1):
            if i >= len(history[k]) or not (trials := history[k][i].trials):
                continue
            sample = [trials[-count:][t % min(count, len(trials))] for t in range(count)]
            require_whole("the paper's adaptation policy", sample)
            observed = np.concatenate([t.observation for t in sample])
            contexts = np.concatenate([task.context.normalise(t.context) for t in sample])
            reward = np.array([t.reward for t in sample])
            mean, own = history[k][i].particle.mean, float(i == particle)
            rows.append((mean, observed, contexts, reward, own, float(latest - k)))
    return PastIterations(*(np.array(column)[None] for column in zip(*rows, strict=True)))


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
        """Random means in Omega that are far from each other."""
        return tuple(Particle(mean[None]) for mean in cover(self.task.parameters, n, rng))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Deterministic. A particle without trials in the last iteration stays."""
        return tuple(
            Particle(self._moved(history, i)[None]) if entry.trials else entry.particle
            for i, entry in enumerate(history[-1])
        )

    def _moved(self, history: Sequence[Iteration], particle: int) -> Array:
        """(p,) the new mean of a particle, in units."""
        task, mean = self.task, history[-1][particle].particle.mean
        state = encode(task, self.memory, seen_in_session(task, history, particle))
        return frozen_array(task.parameters.step(mean, self.network.directions(state)[0], task.adaptation.delta))
