"""RewardTable: the rewards that the policies of some E would earn, for many possible truths in the margin.

Computed once in pretraining and stored in the checkpoint; a session only weighs its columns. A session that begins with
the posterior of another one has other truths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.densities import Prior, unit_points
from sim.adaptation.method import Particle
from sim.errors import CheckpointError
from sim.rollouts.draws import cover
from sim.storage.files import Tensors
from sim.tasks.task import Solver, Task

APART = 0.15
"""Least distance between the particles of an iteration, in fractions of the ranges."""

OPTIMISM = 1.0
"""Optimism of exploring particles, in standard deviations."""


@dataclass(frozen=True)
class RewardTableSettings:
    """The resolution of the reward table."""

    candidates: int = 128
    truths: int = 2048
    contexts: int = 8  # for the average of a reward
    draws: int = 2  # of nuisance and action error, for each context


@dataclass(frozen=True, eq=False)
class RewardTable:
    """`rewards[i, j]` is the expected reward of the policy trained for `candidates[i]` if `truths[j]` is true."""

    candidates: Array  # (C, p) in Omega, in units
    truths: Array  # (T, p) in units, that follow the prior
    rewards: Array  # (C, T)
    session_prior: Prior | None = None  # None: uniform over Omega and its margin

    @property
    def prior(self) -> Prior:
        """The density that the truths follow, in fractions of the margin."""
        return self.session_prior or Prior.uniform(self.truths.shape[1])

    def nearest(self, task: Task, particle: Particle) -> int:
        """The candidate nearest to a particle, in fractions of the ranges."""
        gaps = task.parameters.normalise(self.candidates) - task.parameters.normalise(particle.mean)
        return int(np.linalg.norm(gaps, axis=1).argmin())

    def spread_out(self, task: Task, mean: Array, std: Array, n: int) -> tuple[Particle, ...]:
        """The candidate with the highest mean reward (C,), and others that may earn more; all are at least `APART` from
        each other.
        """
        unit = task.parameters.normalise(self.candidates)
        chosen = [int(np.argmax(mean))]
        while len(chosen) < n:
            gaps = np.linalg.norm(unit[:, None] - unit[chosen][None], axis=-1).min(axis=1)
            chosen.append(int(np.argmax(np.where(gaps < APART, -np.inf, mean + OPTIMISM * std))))
        return tuple(Particle(self.candidates[i][None]) for i in chosen)

    @property
    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays to store; `restore_reward_table` reads them."""
        return {"candidates": self.candidates, "truths": self.truths, "rewards": self.rewards.astype(np.float16)}


def tabulate_rewards(
    solver: Solver,
    seed: int,
    settings: RewardTableSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RewardTable:
    """Compute the reward table.

    Both sets fill their space evenly; contexts, errors and nuisance are the same for all rewards.
    """
    task, rng, s = solver.task, np.random.default_rng(seed), settings or RewardTableSettings()
    candidates = cover(task.parameters, s.candidates, rng)
    truths = cover(task.margin, s.truths, rng)
    contexts = task.context.sample(rng, s.contexts)
    policies = solver.policies(candidates[:, None, :], rng)
    drawn = int(rng.integers(2**31))
    rewards = np.empty((s.candidates, s.truths), dtype=np.float16)
    for i, policy in enumerate(policies):
        actions = np.broadcast_to(policy.actions(contexts), (s.truths, s.contexts, len(task.action)))
        rewards[i] = solver.expected_rewards(truths, contexts, actions, np.random.default_rng(drawn), s.draws)
        if progress is not None:
            progress(i + 1, s.candidates)
    return RewardTable(candidates, truths, rewards.astype(np.float64))


def restore_reward_table(task: Task, tensors: Tensors) -> RewardTable:
    """The stored reward table. Raises CheckpointError if the tensors are not one of this task."""
    try:
        candidates, truths, rewards = (tensors[name].astype(np.float64) for name in ("candidates", "truths", "rewards"))
    except KeyError as error:
        raise CheckpointError(f"the reward table holds no {error}: pretrain again") from error
    table, parameters = RewardTable(candidates, truths, rewards), len(task.parameters)
    if table.candidates.shape[1] != parameters or table.truths.shape[1] != parameters:
        raise CheckpointError(
            f"a reward table of {table.truths.shape[1]} parameters does not fit {task.name}; pretrain again"
        )
    return table


def begun_with(reward_table: RewardTable, task: Task, samples: Array, weights: Array) -> RewardTable:
    """The reward table of a session that begins with the posterior of another one: `samples` (N, p) in units, `weights`
    (N,). The same posterior gives the same table.

    `reward_table` is that of the checkpoint. A new truth has the rewards of the nearest one in it.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - slow to import, and few sessions begin so

    space = task.margin
    low, high = space.physical
    physical = space.normalise(low), space.normalise(high)
    prior = Prior.after(unit_points(space, samples), weights, physical)
    cloud = prior.cloud(len(reward_table.truths))
    nearest = cKDTree(unit_points(space, reward_table.truths)).query(cloud)[1]
    return RewardTable(reward_table.candidates, space.spread(cloud), reward_table.rewards[:, nearest], prior)
