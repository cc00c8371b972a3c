"""Double Q-learning of the adaptation policy, from a replay of meta-episodes.

The target takes the online argmax and the target network's value, averaged over the branches (Tavakoli et al. 2018).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.research.methods.q_network import QNetwork, Weights, new_network
from sim.solvers.threads import one_blas_thread

FIRST_MOMENT, SECOND_MOMENT, TINY = 0.9, 0.999, 1e-8
"""Adam's usual rates (Kingma & Ba 2015)."""

LONGEST = 1.0
"""Longer gradients are shortened to this norm."""


@dataclass(frozen=True, eq=False)
class Transitions:
    """Steps of meta-episodes, one per row."""

    state: Array | Weights  # (N, inputs)
    directions: NDArray[np.int_]  # (N, branches) in {-1, 0, 1}
    reward: Array | Weights  # (N,)
    next_state: Array | Weights  # (N, inputs)


class ReplayBuffer:
    """The last `capacity` transitions."""

    def __init__(self, inputs: int, branches: int, capacity: int = 10_000) -> None:
        state, following = (np.zeros((capacity, inputs), dtype=np.float32) for _ in range(2))
        directions = np.zeros((capacity, branches), dtype=np.int64)
        self._kept = Transitions(state, directions, np.zeros(capacity, dtype=np.float32), following)
        self._capacity, self._next, self._size = capacity, 0, 0

    def __len__(self) -> int:
        return self._size

    def add(self, steps: Transitions) -> None:
        """Add steps; the oldest ones are dropped."""
        rows = (self._next + np.arange(len(steps.reward))) % self._capacity
        for field in fields(Transitions):
            getattr(self._kept, field.name)[rows] = getattr(steps, field.name)
        self._next = int((self._next + len(rows)) % self._capacity)
        self._size = min(self._size + len(rows), self._capacity)

    def sample(self, n: int, rng: np.random.Generator) -> Transitions:
        """`n` transitions with replacement."""
        rows = rng.integers(self._size, size=n)
        return Transitions(*(getattr(self._kept, field.name)[rows] for field in fields(Transitions)))


class DoubleQLearner:
    """Double Q-learning: online and target network with Adam."""

    def __init__(self, network: QNetwork, learning_rate: float, discount: float, polyak: float = 0.01) -> None:
        self.online = network
        self._target = new_network(network.inputs, network.branches, 0, network.slots)
        self._target.flat[:] = network.flat
        self._rate, self._discount, self._polyak = learning_rate, discount, polyak
        self._first, self._second, self._steps = np.zeros_like(network.flat), np.zeros_like(network.flat), 0

    def learn(self, replay: ReplayBuffer, steps: int, batch: int, rng: np.random.Generator) -> float:
        """`steps` gradient steps on samples of `batch` transitions; returns their mean loss."""
        with one_blas_thread():
            return float(np.mean([self._update(replay.sample(batch, rng)) for _ in range(steps)]))

    def _update(self, batch: Transitions) -> float:
        target = branching_target(self.online, self._target, batch.reward, batch.next_state, self._discount)
        q, activations = self.online.values(batch.state)
        choice = batch.directions[..., None] + 1
        error = np.take_along_axis(q, choice, axis=-1) - target[:, None, None]
        slope = np.zeros_like(q)
        np.put_along_axis(slope, choice, error * (2.0 / error.size), axis=-1)
        self._step(self.online.slopes(activations, slope))
        self._target.flat += self._polyak * (self.online.flat - self._target.flat)
        return float((error**2).mean())

    def _step(self, slopes: Weights) -> None:
        """Adam, on gradients of a limited norm."""
        norm = float(np.sqrt(slopes @ slopes))
        if norm > LONGEST:
            slopes *= LONGEST / norm
        self._steps += 1
        self._first += (1.0 - FIRST_MOMENT) * (slopes - self._first)
        self._second += (1.0 - SECOND_MOMENT) * (slopes * slopes - self._second)
        spread = np.sqrt(self._second / (1.0 - SECOND_MOMENT**self._steps))
        spread += TINY
        self.online.flat -= self._rate / (1.0 - FIRST_MOMENT**self._steps) * self._first / spread


def branching_target(
    online: QNetwork, target: QNetwork, reward: Weights, following: Weights, discount: float
) -> Weights:
    """(B,) reward + discount * mean over branches of target(s', argmax online(s')).

    No state is terminal: an episode ends with the session, which the state does not show.
    """
    best = online(following).argmax(axis=-1)[..., None]
    value = np.take_along_axis(target(following), best, axis=-1)[..., 0].mean(axis=-1)
    return np.asarray(reward + discount * value)
