"""The networks of an emulator for a task with other ranges: the same predictions, and a start for further training.

Inputs are scaled by the ranges of the task. Between two ranges that is an affine map, which the first layer takes over.
"""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.errors import CheckpointError
from sim.solvers.emulator.network import Emulator, encode
from sim.tasks.task import Task
from sim.types import Space


def adopted(emulator: Emulator, task: Task) -> Emulator:
    """The emulator as one of `task`, the same one with other ranges. Raises CheckpointError if whole numbers differ."""
    theirs, ours = ((t.margin, t.action, t.nuisance) for t in (emulator.task, task))
    for old, new in zip(theirs, ours, strict=True):
        if _levels(old) != _levels(new):
            raise CheckpointError(f"the emulator of {task.name} knows other whole numbers than this object: pretrain")
    low, high = (
        encode(emulator.task, *(np.array(values, dtype=np.float64)[None] for values in ends))[0].astype(np.float64)
        for ends in zip(*((space.low, space.high) for space in ours), strict=True)
    )
    whole = np.concatenate([_is_whole(space) for space in ours])
    scale, shift = np.where(whole, 1.0, (high - low) / 2.0), np.where(whole, 0.0, (high + low) / 2.0)
    tensors = emulator.tensors
    for w, b in (("w0", "b0"), ("pw0", "pb0")):
        first = tensors[w].astype(np.float64)
        tensors[b] = (tensors[b] + np.einsum("f,mfh->mh", shift, first)[:, None]).astype(np.float32)
        tensors[w] = (first * scale[:, None]).astype(np.float32)
    return Emulator(task, tensors)


def _levels(space: Space) -> list[tuple[float, float]]:
    return [(d.low, d.high) for d in space.dimensions if d.scale == "integer"]


def _is_whole(space: Space) -> Array:
    """For each input of a space, whether it belongs to a whole number."""
    return np.concatenate(
        [np.full(int(d.high - d.low) + 1, True) if d.scale == "integer" else [False] for d in space.dimensions]
    ).astype(bool)
