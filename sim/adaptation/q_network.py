"""The adaptation policy: a branching double Q-network over {-delta, 0, +delta} for every parameter.

Branching after Tavakoli et al. (2018): a shared trunk, one value head, one three-way advantage head a
parameter with its mean subtracted; the target takes the online argmax and the target network's value,
averaged over the branches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw.types import Array
from sim.errors import CheckpointError
from sim.solvers.threads import one_thread

MOVES = 3
"""Choices a parameter: down, stay, up."""

_READ = 64
"""Numbers that are kept of a slot."""


class QNetwork(nn.Module):
    """(B, slots * inputs) -> (B, branches, 3).

    With more than one slot each is read by the same small network, and what they say is pooled: the order of the slots
    does not matter, except that the first is also seen alone. The last input of a slot says whether it is filled.
    """

    def __init__(self, inputs: int, branches: int, slots: int = 1, hidden: int = 256) -> None:
        super().__init__()
        self.inputs, self.branches, self.slots = inputs, branches, slots
        first = inputs if slots == 1 else 3 * _READ
        self.trunk = nn.Sequential(nn.Linear(first, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU())
        self.value = nn.Sequential(nn.Linear(hidden, hidden // 2), nn.ReLU(), nn.Linear(hidden // 2, 1))
        self.advantage = nn.Sequential(
            nn.Linear(hidden, hidden // 2), nn.ReLU(), nn.Linear(hidden // 2, branches * MOVES)
        )
        self.reader = (
            nn.Identity()
            if slots == 1
            else nn.Sequential(nn.Linear(inputs, 2 * _READ), nn.ReLU(), nn.Linear(2 * _READ, _READ), nn.ReLU())
        )

    def forward(self, x: Tensor) -> Tensor:
        features = self.trunk(self._pooled(x))
        advantage = self.advantage(features).reshape(-1, self.branches, MOVES)
        q: Tensor = self.value(features)[:, :, None] + advantage - advantage.mean(dim=-1, keepdim=True)
        return q

    def _pooled(self, x: Tensor) -> Tensor:
        if self.slots == 1:
            return x
        slots = x.reshape(-1, self.slots, self.inputs)
        there = slots[..., -1:]
        read = self.reader(slots) * there
        mean = read.sum(dim=1) / there.sum(dim=1).clamp(min=1.0)
        return torch.cat([read[:, 0], mean, read.amax(dim=1)], dim=-1)

    def directions(self, states: Array) -> NDArray[np.int_]:
        """(B, slots * inputs) -> (B, branches) in {-1, 0, 1}, greedy."""
        with one_thread(), torch.no_grad():
            return np.asarray(self(torch.from_numpy(states).float()).argmax(dim=-1).numpy() - 1, dtype=np.int_)


def new_network(inputs: int, branches: int, seed: int, slots: int = 1) -> QNetwork:
    """Freshly initialised from `seed` alone."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return QNetwork(inputs, branches, slots)


def restore_network(inputs: int, branches: int, tensors: Mapping[str, Tensor], slots: int = 1) -> QNetwork:
    """Raises CheckpointError when the tensors do not fit."""
    network = new_network(inputs, branches, 0, slots)
    wanted = {name: tuple(t.shape) for name, t in network.state_dict().items()}
    found = {name: tuple(t.shape) for name, t in tensors.items()}
    if wanted != found:
        wrong = sorted(n for n in wanted.keys() | found.keys() if wanted.get(n) != found.get(n))
        raise CheckpointError(f"the adaptation policy does not fit the task: {', '.join(wrong[:3])}; pretrain it again")
    network.load_state_dict(dict(tensors))
    return network


@dataclass(frozen=True, eq=False)
class Transitions:
    """Steps of meta-episodes, one a row."""

    state: Array  # (N, inputs)
    directions: NDArray[np.int_]  # (N, branches)
    reward: Array  # (N,)
    next_state: Array  # (N, inputs)


class Replay:
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
        rows = (self._next + np.arange(len(steps.reward))) % self._capacity
        for column, values in zip(
            self._columns, (steps.state, steps.directions + 1, steps.reward, steps.next_state), strict=True
        ):
            column[torch.from_numpy(rows)] = torch.from_numpy(np.asarray(values)).to(column.dtype)
        self._next = int((self._next + len(rows)) % self._capacity)
        self._size = min(self._size + len(rows), self._capacity)

    def sample(self, n: int, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        rows = torch.from_numpy(rng.integers(self._size, size=n))
        state, choice, reward, following = (column[rows] for column in self._columns)
        return state, choice, reward, following


class Learner:
    """Double Q-learning: online and target network with their optimiser."""

    def __init__(self, network: QNetwork, learning_rate: float, discount: float, polyak: float = 0.01) -> None:
        self.online = network
        self._target = new_network(network.inputs, network.branches, 0, network.slots)
        self._target.load_state_dict(network.state_dict())
        self._optimiser = torch.optim.Adam(network.parameters(), lr=learning_rate, fused=True)
        self._discount, self._polyak = discount, polyak

    def update(self, batch: tuple[Tensor, Tensor, Tensor, Tensor]) -> float:
        """One gradient step on a batch of `Replay.sample`; returns its loss."""
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

    No state is terminal: an episode ends because the session is over, which the state does not show.
    """
    with torch.no_grad():
        best = online(following).argmax(dim=-1, keepdim=True)
        value = target(following).gather(-1, best)[..., 0].mean(dim=-1)
        return torch.add(reward, value, alpha=discount)
