"""Training of the adaptation policy in Phase 1: double Q-learning over episodes of adapting to random targets.

As in the paper, K counts episodes: its 10,000 are ten times as many steps. Their observations would be 200,000 true
rollouts. So they come from the emulator's ensemble (`sim.research.pretraining.acting`), and task policies are reused
(`sim.research.pretraining.acting`); a task with an exact solver needs neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.checkpoint import Targets
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, new_policy
from sim.research.pretraining.episodes import Episodes, Running, Simulator, join_episodes, sparse
from sim.research.pretraining.logs import Log, silent
from sim.research.pretraining.q_training import DoubleQLearner, ReplayBuffer, Transitions
from sim.tasks.task import Task

BATCH = 64
EPSILON_FIRST, EPSILON_LAST = 1.0, 0.1

TARGETS: tuple[Targets, ...] = get_args(Targets)


@dataclass(frozen=True)
class MetaSettings:
    """The length of an adaptation policy's training."""

    episodes: int = 10_000  # K, of one particle over the task's horizon, rounded up to whole rounds
    parallel: int = 250  # particles at once
    particles: int = 2  # that adapt to the same target, as in a session
    updates: int = 1  # gradient steps per adaptation step
    library: int = 2048  # task policies that are reused; not with an exact solver, nor with NAF
    targets: Targets = "paper"

    def steps(self, task: Task) -> int:
        """Number of steps of all parallel particles, in whole episodes."""
        return task.adaptation.horizon * -(-self.episodes // self.parallel)

    def visits(self, task: Task) -> int:
        """Number of distributions visited in a training."""
        return self.parallel * self.steps(task) * (task.adaptation.horizon + 1) // task.adaptation.horizon


@dataclass(frozen=True, eq=False)
class MetaCurve:
    """The learning curve: means over the steps of each round of parallel episodes."""

    reward: Array  # (n,) expected reward of the distributions visited, not sparse
    epsilon: Array  # (n,)
    loss: Array  # (n,)


def sample_targets(task: Task, kind: Targets, n: int, rng: np.random.Generator) -> Array:
    """(n, p) random targets, never those of a benchmark."""
    return (task.parameters if kind == "paper" else task.margin).sample(rng, n)


def train_adaptation(
    simulator: Simulator,
    settings: MetaSettings,
    seed: int,
    memory: MemoryName = "iteration",
    progress: Callable[[int, int], None] | None = None,
    log: Log = silent,
) -> tuple[QNetwork, MetaCurve, Episodes]:
    """An adaptation policy, by default the paper's, with its episodes. The same seed gives the same network."""
    task, rng = simulator.solver.task, np.random.default_rng(seed)
    learner = DoubleQLearner(
        new_policy(task, memory, int(rng.integers(2**31))), task.adaptation.learning_rate, task.adaptation.discount
    )
    replay = ReplayBuffer(learner.online.slots * learner.online.inputs, learner.online.branches)
    curve, parts = _Curve(log), []
    for now in np.linspace(EPSILON_FIRST, EPSILON_LAST, settings.steps(task)).reshape(-1, task.adaptation.horizon):
        targets = sample_targets(task, settings.targets, settings.parallel // settings.particles, rng)
        running = Running(simulator, targets, settings.particles, rng)
        state, rows = running.state(memory), []
        for epsilon in now:
            directions = explore(learner.online.directions(state), epsilon, rng)
            rewards, before = running.step(directions), state
            state = running.state(memory)
            replay.add(Transitions(before, directions, sparse(task, rewards), state))
            loss = learner.learn(replay, settings.updates * len(directions), BATCH, rng)
            rows.append((float(rewards.mean()), float(epsilon), loss))
        parts.append(running.episodes())
        curve.add(rows)
        if progress is not None:
            progress(min(len(curve.rows) * settings.parallel, settings.episodes), settings.episodes)
    return learner.online, curve.done(), join_episodes(parts)


class _Curve:
    def __init__(self, log: Log) -> None:
        self.rows: list[Array] = []
        self._log = log

    def add(self, steps: Sequence[tuple[float, float, float]]) -> None:
        mean = np.mean(steps, axis=0)
        for name, value in zip(("reward", "epsilon", "loss"), mean, strict=True):
            self._log(f"adaptation/{name}", float(value), len(self.rows))
        self.rows.append(mean)

    def done(self) -> MetaCurve:
        return MetaCurve(*np.array(self.rows).T)


def explore(directions: NDArray[np.int_], epsilon: float, rng: np.random.Generator) -> NDArray[np.int_]:
    """(B, p): every row is replaced by a random one with probability `epsilon`."""
    random = rng.integers(-1, 2, directions.shape)
    return np.asarray(np.where(rng.random((len(directions), 1)) < epsilon, random, directions), dtype=np.int_)
