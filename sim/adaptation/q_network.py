"""The adaptation policy: a branching double Q-network over {-delta, 0, +delta} for every parameter.

Branching after Tavakoli et al. (2018): a shared trunk, one value head, and one three-way advantage head per parameter
with its mean subtracted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw.types import Array
from sim.errors import CheckpointError
from sim.solvers.threads import one_thread
from sim.storage.tensors import Tensors

MOVES = 3
"""Choices per parameter: down, stay, up."""

_READ = 64
"""Numbers in the encoding of a slot."""


class QNetwork(nn.Module):
    """(B, slots * inputs) -> (B, branches, 3).

    With more than one slot, the same small network encodes each, and the encodings are pooled. So the order of the
    slots does not matter, except that the first is also seen alone. The last input of a slot says whether it is filled.
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
        """(B, slots * inputs) -> (B, branches, 3) action values."""
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

    @property
    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays to store; `restore_network` reads them."""
        return {name: t.numpy() for name, t in self.state_dict().items()}

    def directions(self, states: Array) -> NDArray[np.int_]:
        """(B, slots * inputs) -> (B, branches) in {-1, 0, 1}, greedy."""
        with one_thread(), torch.no_grad():
            return np.asarray(self(torch.from_numpy(states).float()).argmax(dim=-1).numpy() - 1, dtype=np.int_)


def new_network(inputs: int, branches: int, seed: int, slots: int = 1) -> QNetwork:
    """A new network, initialised from `seed` only."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return QNetwork(inputs, branches, slots)


def restore_network(inputs: int, branches: int, tensors: Tensors, slots: int = 1) -> QNetwork:
    """The stored network. Raises CheckpointError if the tensors do not fit."""
    network = new_network(inputs, branches, 0, slots)
    wanted = {name: tuple(t.shape) for name, t in network.state_dict().items()}
    found = {name: tuple(t.shape) for name, t in tensors.items()}
    if wanted != found:
        wrong = sorted(n for n in wanted.keys() | found.keys() if wanted.get(n) != found.get(n))
        raise CheckpointError(f"the adaptation policy does not fit the task: {', '.join(wrong[:3])}; pretrain it again")
    network.load_state_dict({name: torch.from_numpy(t) for name, t in tensors.items()})
    return network
