"""Training of the adaptation policy in Phase 1: double Q-learning over episodes of adapting to random targets, and the
learning gate.

K counts episodes here, although Table A1 of the paper calls them steps. Each of its 10,000 episodes has as many steps
as the horizon. In the contact tasks, their observations would need 180,000 true rollouts, because an episode has two in
each of nine distributions. So they come from the emulator's ensemble, and task policies are reused
(`sim.research.pretraining.episodes`); a task with an exact solver needs neither.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.card import Targets
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName, new_policy
from sim.research.pretraining.episodes import Episodes, Running, Simulator, join_episodes, sparse, visit
from sim.research.pretraining.logs import Log, silent
from sim.research.pretraining.q_training import DoubleQLearner, ReplayBuffer, Transitions
from sim.tasks.task import Task

BATCH = 64
EPSILON_FIRST, EPSILON_LAST = 1.0, 0.1

GATE_TARGETS = 512
"""Unseen targets, one particle each."""

_ENDS = 3
"""The last distributions of the policy, of staying, and of drifting are visited once more, under equal conditions."""

CURVE = ("reward", "epsilon", "loss")
"""Columns of a learning curve."""

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

    def distributions(self, task: Task) -> int:
        """Number of distributions visited in a training."""
        return self.parallel * self.steps(task) * (task.adaptation.horizon + 1) // task.adaptation.horizon


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
) -> tuple[QNetwork, Array, Episodes]:
    """An adaptation policy, by default the paper's, with its learning curve and its episodes.

    The curve (n, 3) holds means over the steps of each round of parallel episodes: the expected reward of the
    distributions visited (not sparse), epsilon, and the loss. The same seed gives the same network.
    """
    task, rng = simulator.solver.task, np.random.default_rng(seed)
    learner = DoubleQLearner(
        new_policy(task, memory, int(rng.integers(2**31))), task.adaptation.learning_rate, task.adaptation.discount
    )
    replay = ReplayBuffer(learner.online.slots * learner.online.inputs, learner.online.branches)
    curve, parts = list[Array](), []
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
        curve.append(np.mean(rows, axis=0))
        log(curve[-1].tolist())
        if progress is not None:
            progress(min(len(curve) * settings.parallel, settings.episodes), settings.episodes)
    return learner.online, np.array(curve), join_episodes(parts)


def explore(directions: NDArray[np.int_], epsilon: float, rng: np.random.Generator) -> NDArray[np.int_]:
    """(B, p): every row is replaced by a random one with probability `epsilon`."""
    random = rng.integers(-1, 2, directions.shape)
    return np.asarray(np.where(rng.random((len(directions), 1)) < epsilon, random, directions), dtype=np.int_)


def gate_distributions(task: Task) -> int:
    """Number of distributions visited by the gate."""
    return GATE_TARGETS * (task.adaptation.horizon + 1 + _ENDS)


@dataclass(frozen=True)
class Gate:
    """Mean expected rewards of the last distributions of whole sessions from the same starts."""

    policy: float
    stay: float
    drift: float  # always the policy's own mean direction
    above_ci95: tuple[float, float]  # of the policy - the better of the other two, paired by target
    passed: bool  # the whole interval lies above zero


def learning_gate(
    simulator: Simulator,
    network: QNetwork,
    memory: MemoryName,
    seed: int,
    kind: Targets = "paper",
    count: int = GATE_TARGETS,
) -> Gate:
    """Whether an adaptation policy uses its observations, in `count` unseen targets of the simulator of its training.

    It must earn more than staying where it starts, and more than its own mean drift, in which the observations play no
    part.
    """
    task, rng = simulator.solver.task, np.random.default_rng(seed)
    targets = sample_targets(task, kind, count, rng)
    running = Running(simulator, targets, 1, rng)
    for _ in range(task.adaptation.horizon):
        running.step(network.directions(running.state(memory)))
    ran, final = running.episodes(), int(rng.integers(2**31))
    mean = np.round(ran.directions.mean(axis=(0, 1, 2))).astype(np.int_)
    start = drifted = ran.means[:, 0, 0]
    for _ in range(task.adaptation.horizon):
        drifted = task.parameters.step(drifted, mean, task.adaptation.delta)

    def earned(means: Array) -> Array:
        """(count,) with the same random draws for all three."""
        return visit(simulator, means, targets, np.random.default_rng(final)).rewards

    policy, stay, drift = (earned(means) for means in (ran.means[:, 0, -1], start, drifted))
    better = stay if stay.mean() >= drift.mean() else drift
    drawn = rng.integers(count, size=(2000, count))
    low, high = np.quantile((policy - better)[drawn].mean(axis=1), [0.025, 0.975])
    return Gate(
        float(policy.mean()), float(stay.mean()), float(drift.mean()), (float(low), float(high)), bool(low > 0.0)
    )
