"""The self-test of a checkpoint: a prediction stored in its card, repeated whenever it is loaded.

The hash in the card says that the weights are those of the card. This says that they are still a working emulator here:
finite, of the right shapes, and with the same answers as where they were trained.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import CheckpointError
from sim.solvers.emulator.network import Emulator

SELF_TEST = "self_test"
INPUTS, SEED = 4, 1908
TOLERANCE = 1e-3
"""Between processors, float32 differs by 1e-6; a changed weight by more."""
LARGEST = 1e12


def require_finite(tensors: Mapping[str, NDArray[Any]], where: Path) -> None:
    """Raise CheckpointError unless every number is finite and of a size that a trained network has."""
    for name, values in sorted(tensors.items()):
        if values.dtype.kind != "f":
            continue
        if not np.isfinite(values).all():
            raise CheckpointError(f"{where}: {name} holds numbers that are not finite: pretrain again")
        if values.size and float(np.abs(values).max()) > LARGEST:
            raise CheckpointError(
                f"{where}: {name} holds {float(np.abs(values).max()):.1e}, at most {LARGEST:.0e} is possible: pretrain "
                "again"
            )


def predictions(emulator: Emulator) -> list[float]:
    """Observation, success and end state that the emulator predicts for a few drawn trials, one after another."""
    task, rng = emulator.task, np.random.default_rng(SEED)
    spaces = (task.margin, task.action, task.nuisance)
    drawn = [space.denormalise(rng.uniform(0.0, 1.0, (INPUTS, len(space)))) for space in spaces]
    try:
        found = emulator.predict(*drawn)
    except (ValueError, IndexError, KeyError) as error:
        raise CheckpointError(f"the emulator's weights do not fit one another ({error}): pretrain again") from error
    parts = (found.observation, found.success, found.end_state)
    return [round(float(value), 7) for part in parts for value in np.ravel(part)]


def require_same(emulator: Emulator, stored: Sequence[float] | None, where: Path) -> None:
    """Raise CheckpointError unless the emulator repeats the prediction in its card."""
    if stored is None:
        raise CheckpointError(
            f"{where} has no {SELF_TEST}: add it with `python benchmarks/self_tests.py {where.parent}`, or "
            "pretrain again"
        )
    now = np.array(predictions(emulator))
    then = np.array(stored, dtype=np.float64)
    if now.shape != then.shape or not np.isfinite(now).all():
        raise CheckpointError(f"{where}: the emulator does not predict what its card says: pretrain again")
    off = float(np.abs(now - then).max())
    if off > TOLERANCE * max(1.0, float(np.abs(then).max())):
        raise CheckpointError(
            f"{where}: the emulator predicts {off:.2g} beside the prediction in its card (limit {TOLERANCE:g}): its "
            "weights were changed; install or make the checkpoint again"
        )
