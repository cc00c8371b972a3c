"""The adaptation policy: a branching double Q-network over {-delta, 0, +delta} for every parameter.

Branching after Tavakoli et al. (2018): a shared trunk, one value head, and one three-way advantage head per parameter
with its mean subtracted.

Values and gradients are written out in numpy, over one vector of all weights. For networks this small, torch needs
three times as long for a gradient step (1.7 ms instead of 0.56 ms), and most of that is not arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import CheckpointError
from sim.solvers.threads import one_blas_thread
from sim.storage.files import Tensors

MOVES = 3
"""Choices per parameter: down, stay, up."""

HIDDEN, READ = 128, 64
"""Numbers in a hidden layer, and in the encoding of a slot."""

Weights = NDArray[np.floating[Any]]
"""float32; float64 in a test of the gradient."""


@dataclass(frozen=True, eq=False)
class _Chain:
    """Dense layers with a ReLU after each, or after each but the last."""

    layers: Sequence[tuple[Weights, Weights]]  # weight (inputs, outputs) and bias (outputs,) of each
    rectified: bool  # after the last one too

    def __call__(self, x: Weights) -> list[Weights]:
        """x (..., inputs) -> the output of each layer."""
        activations = [x]
        for i, (weight, bias) in enumerate(self.layers):
            y = activations[-1] @ weight
            y += bias
            if self.rectified or i + 1 < len(self.layers):
                np.maximum(y, 0.0, out=y)
            activations.append(y)
        return activations

    def back(self, activations: Sequence[Weights], slope: Weights, into: _Chain) -> Weights:
        """Put the slopes of the weights into the chain `into`, from `slope` of the output; return that of the input."""
        for i in reversed(range(len(self.layers))):
            if self.rectified or i + 1 < len(self.layers):
                slope = slope * (activations[i + 1] > 0.0)
            weight, bias = into.layers[i]
            np.matmul(activations[i].T, slope, out=weight)
            np.sum(slope, axis=0, out=bias)
            slope = slope @ self.layers[i][0].T
        return slope


class _Chains:
    """The chains of a network, as views of one vector."""

    def __init__(self, flat: Weights, sizes: dict[str, tuple[int, ...]]) -> None:
        self.tensors: dict[str, Weights] = {}
        start = 0
        chains = {}
        for name, widths in sizes.items():
            layers = []
            for i, (inputs, outputs) in enumerate(pairwise(widths)):
                for kind, shape in (("weight", (inputs, outputs)), ("bias", (outputs,))):
                    end = start + int(np.prod(shape))
                    self.tensors[f"{name}.{i}.{kind}"] = flat[start:end].reshape(shape)
                    start = end
                layers.append((self.tensors[f"{name}.{i}.weight"], self.tensors[f"{name}.{i}.bias"]))
            chains[name] = _Chain(layers, rectified=name in ("reader", "trunk"))
        self.reader, self.trunk = chains.get("reader"), chains["trunk"]
        self.value, self.advantage = chains["value"], chains["advantage"]


@dataclass(frozen=True, eq=False)
class _Pass:
    """The intermediate values of a network."""

    slots: Weights | None  # (B, S, inputs); None with one slot
    read: list[Weights] | None
    pooled: Weights | None  # (B, S, READ) the encodings of the slots, zero where there is none
    trunk: list[Weights]
    value: list[Weights]
    advantage: list[Weights]


class QNetwork:
    """(B, slots * inputs) -> (B, branches, 3).

    With more than one slot, the same small network encodes each, and the encodings are pooled. So the order of the
    slots does not matter, except that the first is also seen alone. The last input of a slot says whether it is filled.
    """

    def __init__(self, inputs: int, branches: int, slots: int = 1, flat: Weights | None = None) -> None:
        """`flat` (n,) holds all weights, 0 if it is None; the network keeps it and does not copy it."""
        self.inputs, self.branches, self.slots = inputs, branches, slots
        half = HIDDEN // 2
        sizes: dict[str, tuple[int, ...]] = {} if slots == 1 else {"reader": (inputs, 2 * READ, READ)}
        sizes["trunk"] = (inputs if slots == 1 else 3 * READ, HIDDEN, HIDDEN)
        sizes |= {"value": (HIDDEN, half, 1), "advantage": (HIDDEN, half, branches * MOVES)}
        self._sizes = sizes
        count = sum((a + 1) * b for widths in sizes.values() for a, b in pairwise(widths))
        self.flat = np.zeros(count, dtype=np.float32) if flat is None else flat
        self._parts = _Chains(self.flat, sizes)
        self._slopes = np.zeros_like(self.flat)
        self._into = _Chains(self._slopes, sizes)

    def __call__(self, x: Weights) -> Weights:
        """(B, slots * inputs) -> (B, branches, 3) action values."""
        return self.values(x)[0]

    def values(self, x: Weights) -> tuple[Weights, _Pass]:
        """Action values (B, branches, 3), and the input of `slopes`."""
        parts = self._parts
        slots = read = pooled = None
        if parts.reader is not None:
            slots = x.reshape(-1, self.slots, self.inputs)
            present = slots[..., -1:]
            read = parts.reader(slots.reshape(-1, self.inputs))
            pooled = read[-1].reshape(*slots.shape[:2], READ) * present
            mean = pooled.sum(axis=1) / np.maximum(present.sum(axis=1), 1.0)
            x = np.concatenate([pooled[:, 0], mean, pooled.max(axis=1)], axis=-1)
        trunk = parts.trunk(x)
        value, advantage = parts.value(trunk[-1]), parts.advantage(trunk[-1])
        three = advantage[-1].reshape(-1, self.branches, MOVES)
        q = value[-1][:, :, None] + three - three.mean(axis=-1, keepdims=True)
        return q, _Pass(slots, read, pooled, trunk, value, advantage)

    def slopes(self, forward: _Pass, slope: Weights) -> Weights:
        """(n,) slopes of all weights, from `slope` (B, branches, 3) of the action values; valid until the next call."""
        parts, into = self._parts, self._into
        three = slope - slope.mean(axis=-1, keepdims=True)
        of_value = slope.sum(axis=(1, 2))[:, None]
        of_trunk = parts.value.back(forward.value, of_value, into.value)
        of_trunk += parts.advantage.back(forward.advantage, three.reshape(len(slope), -1), into.advantage)
        of_pooled = parts.trunk.back(forward.trunk, of_trunk, into.trunk)
        if forward.slots is not None and forward.read is not None and forward.pooled is not None:
            assert parts.reader is not None and into.reader is not None
            present = forward.slots[..., -1:]
            first, mean, most = np.split(of_pooled, 3, axis=-1)
            of_slots = np.repeat((mean / np.maximum(present.sum(axis=1), 1.0))[:, None], self.slots, axis=1)
            of_slots[:, 0] += first
            where = forward.pooled.argmax(axis=1)[:, None]
            np.put_along_axis(of_slots, where, np.take_along_axis(of_slots, where, axis=1) + most[:, None], axis=1)
            parts.reader.back(forward.read, (of_slots * present).reshape(-1, READ), into.reader)
        return self._slopes

    @property
    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays to store; `restore_network` reads them."""
        return {name: t.copy() for name, t in self._parts.tensors.items()}

    def directions(self, states: NDArray[Any]) -> NDArray[np.int_]:
        """(B, slots * inputs) -> (B, branches) in {-1, 0, 1}, greedy."""
        with one_blas_thread():
            return np.asarray(self(states.astype(np.float32)).argmax(axis=-1) - 1, dtype=np.int_)


def new_network(inputs: int, branches: int, seed: int, slots: int = 1) -> QNetwork:
    """A new network, initialised from `seed` only: uniform within 1 / sqrt(inputs) of each layer."""
    network, rng = QNetwork(inputs, branches, slots), np.random.default_rng(seed)
    weights = network._parts.tensors
    for name, tensor in weights.items():
        reach = len(weights[name.replace("bias", "weight")]) ** -0.5
        tensor[...] = rng.uniform(-reach, reach, tensor.shape)
    return network


def restore_network(inputs: int, branches: int, tensors: Tensors, slots: int = 1) -> QNetwork:
    """The stored network. Raises CheckpointError if the tensors do not fit."""
    network = QNetwork(inputs, branches, slots)
    weights = network._parts.tensors
    expected = {name: t.shape for name, t in weights.items()}
    shapes = {name: tuple(t.shape) for name, t in tensors.items()}
    if expected != shapes:
        wrong = sorted(n for n in expected.keys() | shapes.keys() if expected.get(n) != shapes.get(n))
        raise CheckpointError(f"the adaptation policy does not fit the task: {', '.join(wrong[:3])}; pretrain it again")
    for name, tensor in weights.items():
        tensor[...] = tensors[name]
    return network
