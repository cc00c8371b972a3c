"""A dataset that grows only as long as this lowers the emulator's error.

A slow simulator (`sim.rollouts.cost`) is drawn in batches. After each one a draft of the emulator is trained, and its
error of the reward is measured on rollouts that it has not seen. Once another batch no longer lowers it, the dataset is
complete.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim.rollouts.dataset import build_dataset
from sim.solvers.emulator.training import EmulatorSettings, reward_error, split, train_emulator
from sim.storage.files import read_toml, write_toml
from sim.tasks.task import Task

SMALLEST, GROWTH = 128, 2
"""Rollouts of the first batch, and the factor by which the dataset grows."""

FALLS = 0.95
"""A batch must lower the error to this share of the earlier one; otherwise it is the last batch."""

GROWN = "growth.toml"


def enough_rollouts(
    task: Task,
    folder: Path,
    most: int,
    seed: int,
    settings: EmulatorSettings,
    executor: Executor,
    progress: Callable[[int, int], None],
) -> int:
    """The size at which the dataset in `folder` stops lowering the emulator's error, at most `most`.

    The sizes and errors are kept in `GROWN`, so that an interrupted run can continue.
    """
    growth = read_toml(folder / GROWN) if (folder / GROWN).exists() else {}
    errors: dict[str, float] = dict(growth.get("errors", {}))
    draft, size, before = replace(settings, passes=20, most_steps=3000), min(SMALLEST, most), float("inf")
    while size < most:
        if str(size) not in errors:
            dataset = build_dataset(task, folder, size, seed, executor, lambda i, _: progress(i, most))
            emulator, _ = train_emulator(task, dataset, seed, draft)
            _, unseen, _ = split(dataset, np.random.default_rng(seed), draft)
            errors[str(size)] = reward_error(emulator, *dataset.select(unseen))
            write_toml(folder / GROWN, {"errors": errors})
        if errors[str(size)] > FALLS * before:
            return size
        before, size = errors[str(size)], min(GROWTH * size, most)
    return most
