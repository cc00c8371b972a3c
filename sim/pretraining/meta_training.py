"""Training of the adaptation policy in Phase 1: double Q-learning over episodes of adapting to random targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.card import Targets
from sim.adaptation.memory import MemoryName, inputs, new_policy
from sim.adaptation.q_network import QNetwork
from sim.pretraining.episodes import Episodes, EpisodeSettings, Visit, join_episodes, sparse, visit
from sim.pretraining.logs import Log, silent
from sim.pretraining.q_training import DoubleQLearner, ReplayBuffer, Transitions
from sim.rollouts.run import Roll
from sim.solvers.solver import Solver
from sim.tasks.task import Task

BATCH = 64
EPSILON_FIRST, EPSILON_LAST = 1.0, 0.1

TARGETS: tuple[Targets, ...] = get_args(Targets)


@dataclass(frozen=True)
class MetaSettings:
    """The length of the adaptation policy's training."""

    steps: int = 10_000  # K, adaptation steps over all episodes, rounded up to whole episodes
    parallel: int = 64  # particles at once
    particles: int = 2  # per episode; they adapt to the same target, as in a session
    updates: int = 1  # gradient steps per adaptation step
    targets: Targets = "paper"

    def rounds(self, horizon: int) -> int:
        """Number of rounds of `parallel` adaptation steps, for whole episodes."""
        return horizon * -(-self.steps // (self.parallel * horizon))


@dataclass(frozen=True, eq=False)
class MetaCurve:
    """The training curve, one entry per round of all parallel particles."""

    reward: Array  # (n,) mean expected reward of the distributions visited, not sparse
    epsilon: Array  # (n,)
    loss: Array  # (n,)


def sample_targets(task: Task, kind: Targets, n: int, rng: np.random.Generator) -> Array:
    """(n, p) random targets, never those of a benchmark."""
    return (task.parameters if kind == "paper" else task.margin).sample(rng, n)


def train_adaptation(
    solver: Solver,
    roll: Roll,
    settings: MetaSettings,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    log: Log = silent,
    threshold: float | None = None,
) -> tuple[QNetwork, MetaCurve, Episodes]:
    """The paper's adaptation policy after `steps` adaptation steps, with its episodes.

    Rewards count from `threshold` on, by default the paper's. It sees one iteration at a time (memory "iteration").
    The same seed gives the same network.
    """
    task, rng = solver.task, np.random.default_rng(seed)
    horizon = task.adaptation.horizon
    learner = _learner(task, "iteration", int(rng.integers(2**31)))
    replay = ReplayBuffer(learner.online.inputs, learner.online.branches)
    curve, parts = _Curve(log), []
    rounds = settings.rounds(horizon)
    for start in range(0, rounds, horizon):
        epsilons = _epsilons(rounds)[start : start + horizon]
        recorded = _Recorder(solver, roll, settings, rng)
        for epsilon in epsilons:
            state = recorded.state()
            directions = explore(learner.online.directions(state), epsilon, rng)
            rewards = recorded.step(directions)
            replay.add(Transitions(state, directions, sparse(task, rewards, threshold), recorded.state()))
            loss = [learner.update(replay.sample(BATCH, rng)) for _ in range(settings.updates * settings.parallel)]
            curve.add(float(rewards.mean()), float(epsilon), float(np.mean(loss)))
            if progress is not None:
                progress(min(len(curve.rows) * settings.parallel, settings.steps), settings.steps)
        parts.append(recorded.episodes())
    return learner.online, curve.done(), join_episodes(parts)


def learn_from(
    task: Task,
    episodes: Episodes,
    memory: MemoryName,
    updates: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    threshold: float | None = None,
) -> QNetwork:
    """An adaptation policy with `memory`, learnt from another policy's episodes, without simulation.

    Q-learning can learn from the choices of another policy. The same seed gives the same network.
    """
    rng = np.random.default_rng(seed)
    learner = _learner(task, memory, int(rng.integers(2**31)))
    steps = episodes.transitions(task, memory, threshold)
    slots, width = inputs(task, memory)
    replay = ReplayBuffer(slots * width, len(task.parameters), capacity=len(steps.reward))
    replay.add(steps)
    for i in range(updates):
        learner.update(replay.sample(BATCH, rng))
        if progress is not None and (i % 256 == 255 or i + 1 == updates):
            progress(i + 1, updates)
    return learner.online


def _learner(task: Task, memory: MemoryName, seed: int) -> DoubleQLearner:
    return DoubleQLearner(new_policy(task, memory, seed), task.adaptation.learning_rate, task.adaptation.discount)


def _epsilons(rounds: int) -> Array:
    return np.linspace(EPSILON_FIRST, EPSILON_LAST, rounds)


class _Recorder:
    """Running episodes, all at the same step."""

    def __init__(self, solver: Solver, roll: Roll, settings: MetaSettings, rng: np.random.Generator) -> None:
        self._solver, self._roll, self._rng = solver, roll, rng
        self._shape = (settings.parallel // settings.particles, settings.particles)
        targets = sample_targets(solver.task, settings.targets, self._shape[0], rng)
        self._targets = np.repeat(targets, settings.particles, axis=0)
        self._means = [solver.task.parameters.sample(rng, settings.parallel)]
        self._visits = [self._visit()]
        self._directions: list[Array] = []

    def _visit(self) -> Visit:
        return visit(self._solver, self._roll, self._means[-1], self._targets, self._rng, EpisodeSettings())

    def state(self) -> Array:
        """(B, inputs) the state for the paper's policy."""
        task, seen = self._solver.task, self._visits[-1].observations
        return np.concatenate([task.parameters.normalise(self._means[-1]), seen], axis=-1)

    def step(self, directions: NDArray[np.int_]) -> Array:
        """Move the means, visit the new ones, and return their expected rewards (B,)."""
        task = self._solver.task
        self._directions.append(directions.astype(np.float64))
        self._means.append(task.parameters.step(self._means[-1], directions, task.adaptation.delta))
        self._visits.append(self._visit())
        return self._visits[-1].rewards

    def episodes(self) -> Episodes:
        def grouped(rows: Sequence[Array]) -> Array:
            """n times (B, ...) -> (E, P, n, ...)"""
            return np.stack(rows, axis=1).reshape(*self._shape, len(rows), *np.shape(rows[0])[1:])

        return Episodes(
            targets=self._targets[:: self._shape[1]],
            means=grouped(self._means),
            observations=grouped([v.observations for v in self._visits]),
            trial_rewards=grouped([v.trial_rewards for v in self._visits]),
            rewards=grouped([v.rewards for v in self._visits]),
            directions=grouped(self._directions),
        )


class _Curve:
    def __init__(self, log: Log) -> None:
        self.rows: list[tuple[float, float, float]] = []
        self._log = log

    def add(self, reward: float, epsilon: float, loss: float) -> None:
        for name, value in (("reward", reward), ("epsilon", epsilon), ("loss", loss)):
            self._log(f"adaptation/{name}", value, len(self.rows))
        self.rows.append((reward, epsilon, loss))

    def done(self) -> MetaCurve:
        return MetaCurve(*np.array(self.rows).T)


def explore(directions: NDArray[np.int_], epsilon: float, rng: np.random.Generator) -> NDArray[np.int_]:
    """(B, p): every row is replaced by a random one with probability `epsilon`."""
    random = rng.integers(-1, 2, directions.shape)
    return np.asarray(np.where(rng.random((len(directions), 1)) < epsilon, random, directions), dtype=np.int_)
