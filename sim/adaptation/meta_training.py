"""Phase 1, the adaptation policy: double Q-learning over episodes of adapting to random targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.episodes import EpisodeSettings, Roll, visit
from sim.adaptation.q_network import Learner, QNetwork, Replay, Transitions, new_network
from sim.adaptation.step import encode_state, state_size
from sim.solver import Solver
from sim.tasks.task import Task

BATCH = 64
EPSILON_FIRST, EPSILON_LAST = 1.0, 0.1

Targets = Literal["paper", "wide"]
"""Where the targets of training lie: in Omega, as in the paper, or also in the margin around it."""


@dataclass(frozen=True)
class MetaSettings:
    """How long the adaptation policy learns."""

    steps: int = 10_000  # K, adaptation steps over all episodes
    parallel: int = 64  # episodes at once
    updates: int = 1  # gradient steps an adaptation step
    targets: Targets = "paper"


@dataclass(frozen=True, eq=False)
class MetaCurve:
    """How training went, one entry an iteration of all parallel episodes."""

    reward: Array  # (n,) mean expected reward of the distributions visited, not sparse
    epsilon: Array  # (n,)
    loss: Array  # (n,)


def sample_targets(task: Task, kind: Targets, n: int, rng: np.random.Generator) -> Array:
    """(n, p) random targets. Drawn at random, so none is ever one of a benchmark's."""
    return (task.parameters if kind == "paper" else task.margin).sample(rng, n)


def train_adaptation(
    solver: Solver,
    roll: Roll,
    settings: MetaSettings,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[QNetwork, MetaCurve]:
    """The adaptation policy after `steps` adaptation steps. The same seed gives the same network."""
    task, rng = solver.task, np.random.default_rng(seed)
    episode = EpisodeSettings()
    count, horizon = settings.parallel, task.adaptation.horizon
    inputs, branches = state_size(task), len(task.parameters)
    learner = Learner(
        new_network(inputs, branches, int(rng.integers(2**31))), task.adaptation.learning_rate, task.adaptation.discount
    )
    replay = Replay(inputs, branches)
    rewards, epsilons, losses = [], [], []
    rounds = -(-settings.steps // count)
    means = targets = state = np.zeros(0)
    for i in range(rounds):
        if i % horizon == 0:
            targets = sample_targets(task, settings.targets, count, rng)
            means = task.parameters.sample(rng, count)
            first = visit(solver, roll, means, targets, rng, episode)
            state = encode_state(task, means, first.observations)
        epsilon = EPSILON_FIRST + (EPSILON_LAST - EPSILON_FIRST) * i / max(1, rounds - 1)
        directions = explore(learner.online.directions(state), epsilon, rng)
        means = task.parameters.step(means, directions, task.adaptation.delta)
        seen = visit(solver, roll, means, targets, rng, episode)
        following = encode_state(task, means, seen.observations)
        replay.add(Transitions(state, directions, sparse(task, seen.rewards), following))
        state = following
        loss = [learner.update(replay.sample(BATCH, rng)) for _ in range(settings.updates * count)]
        rewards.append(float(seen.rewards.mean()))
        epsilons.append(epsilon)
        losses.append(float(np.mean(loss)))
        if progress is not None:
            progress(min((i + 1) * count, settings.steps), settings.steps)
    return learner.online, MetaCurve(np.array(rewards), np.array(epsilons), np.array(losses))


def sparse(task: Task, rewards: Array) -> Array:
    """Only rewards that reach the threshold count (paper, eq. A1)."""
    return np.where(rewards >= task.adaptation.threshold, rewards, 0.0)


def explore(directions: NDArray[np.int_], epsilon: float, rng: np.random.Generator) -> NDArray[np.int_]:
    """(B, p): every row is replaced by a random one with probability `epsilon`."""
    random = rng.integers(-1, 2, directions.shape)
    return np.asarray(np.where(rng.random((len(directions), 1)) < epsilon, random, directions), dtype=np.int_)
