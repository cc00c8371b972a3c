"""Double Q-learning of the adaptation policy, from a replay of meta-episodes.

The target takes the online argmax and the target network's value, averaged over the branches (Tavakoli et al. 2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw.types import Array
from sim.adaptation.q_network import QNetwork, new_network
from sim.solvers.threads import one_thread


@dataclass(frozen=True, eq=False)
class Transitions:
    """Steps of meta-episodes, one per row."""

    state: Array  # (N, inputs)
    directions: NDArray[np.int_]  # (N, branches)
    reward: Array  # (N,)
    next_state: Array  # (N, inputs)


class ReplayBuffer:
    """The last `capacity` transitions, as tensors."""

    def __init__(self, inputs: int, branches: int, capacity: int = 10_000) -> None:
        self._columns = (
            torch.zeros(capacity, inputs),
            torch.zeros(capacity, branches, dtype=torch.int64),
            torch.zeros(capacity),
            torch.zeros(capacity, inputs),
        )
        self._capacity, self._next, self._size = capacity, 0, 0

    def __len__(self) -> int:
        return self._size

    def add(self, steps: Transitions) -> None:
        """Add steps; the oldest ones are dropped."""
        rows = (self._next + np.arange(len(steps.reward))) % self._capacity
        for column, values in zip(
            self._columns, (steps.state, steps.directions + 1, steps.reward, steps.next_state), strict=True
        ):
            column[torch.from_numpy(rows)] = torch.from_numpy(np.asarray(values)).to(column.dtype)
        self._next = int((self._next + len(rows)) % self._capacity)
        self._size = min(self._size + len(rows), self._capacity)

    def sample(self, n: int, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """`n` transitions with replacement: state, choice (0 to 2 per branch), reward, next state."""
        rows = torch.from_numpy(rng.integers(self._size, size=n))
        state, choice, reward, following = (column[rows] for column in self._columns)
        return state, choice, reward, following


class DoubleQLearner:
    """Double Q-learning: online and target network with their optimiser."""

    def __init__(self, network: QNetwork, learning_rate: float, discount: float, polyak: float = 0.01) -> None:
        self.online = network
        self._target = new_network(network.inputs, network.branches, 0, network.slots)
        self._target.load_state_dict(network.state_dict())
        self._optimiser = torch.optim.Adam(network.parameters(), lr=learning_rate, fused=True)
        self._discount, self._polyak = discount, polyak

    def update(self, batch: tuple[Tensor, Tensor, Tensor, Tensor]) -> float:
        """One gradient step on a batch of `ReplayBuffer.sample`; returns its loss."""
        state, choice, reward, following = batch
        with one_thread():
            target = branching_target(self.online, self._target, reward, following, self._discount)
            taken = self.online(state).gather(-1, choice[..., None])[..., 0]
            loss = ((taken - target[:, None]) ** 2).mean()
            self._optimiser.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(self.online.parameters(), 1.0)
            self._optimiser.step()
            with torch.no_grad():
                for slow, fast in zip(self._target.parameters(), self.online.parameters(), strict=True):
                    slow.lerp_(fast, self._polyak)
        return float(loss.detach())


def branching_target(online: QNetwork, target: QNetwork, reward: Tensor, following: Tensor, discount: float) -> Tensor:
    """(B,) reward + discount * mean over branches of target(s', argmax online(s')).

    No state is terminal: an episode ends with the session, which the state does not show.
    """
    with torch.no_grad():
        best = online(following).argmax(dim=-1, keepdim=True)
        value = target(following).gather(-1, best)[..., 0].mean(dim=-1)
        return torch.add(reward, value, alpha=discount)
