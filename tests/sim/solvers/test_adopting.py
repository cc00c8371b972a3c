"""The networks of an emulator for an object predict what they predicted for the task."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.errors import CheckpointError
from sim.solvers.emulator.network import Emulator, adopted
from sim.tasks import get_task
from sim.tasks.own_object import OwnObject, with_ranges
from sim.types import Space

OBJECTS = {
    "pushing": OwnObject("pushing", "milk", {"mu": (0.08, 0.16), "e": (1e5, 1e6)}),
    "scooping": OwnObject("scooping", "tofu", {"h": (2.0, 2.6), "g": (1, 2)}, {"radius": (0.012, 0.02)}),
}


def emulator_of(name: str) -> Emulator:
    found = load_checkpoint(get_task(name)).emulator
    assert found is not None
    return found


@pytest.mark.parametrize("name", OBJECTS)
def test_predictions_stay(name: str) -> None:
    shipped, task = emulator_of(name), with_ranges(get_task(name), OBJECTS[name])
    own, rng = adopted(shipped, task), np.random.default_rng(0)
    given = [space.sample(rng, 200) for space in (task.margin, task.action, task.nuisance)]
    before, after = shipped.predict(*given), own.predict(*given)
    assert own.task is task
    assert np.allclose(after.observation, before.observation, atol=2e-5)
    assert np.allclose(after.success, before.success, atol=2e-4)
    assert not np.array_equal(own.tensors["w0"], shipped.tensors["w0"])


def test_other_whole_numbers_are_refused() -> None:
    task = get_task("scooping")
    g = task.margin.names.index("g")
    fewer = [replace(d, high=1) if i == g else d for i, d in enumerate(task.margin.dimensions)]
    with pytest.raises(CheckpointError, match="other whole numbers"):
        adopted(emulator_of("scooping"), replace(task, margin=Space(tuple(fewer))))
