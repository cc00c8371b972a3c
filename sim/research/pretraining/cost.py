"""The cost of a pretraining, said before it begins; and a dataset that grows only while that helps.

A slow simulator (`SLOW_S`) is drawn in batches. After each one a draft of the emulator is trained, and its error of the
reward is measured on rollouts that it has not seen. Once another batch no longer lowers it, the dataset is complete.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hw.cores import usable_cores
from sim.rollouts.dataset import build_dataset, draw_requests
from sim.solvers.emulator.training import EmulatorSettings, reward_error, split, train_emulator
from sim.storage.files import read_toml, write_toml
from sim.tasks.task import Task

SLOW_S = 0.5
"""A rollout that takes longer is worth a draft of the emulator."""

SMALLEST, GROWTH = 128, 2
"""Rollouts of the first batch, and the factor by which the dataset grows."""

FALLS = 0.95
"""A batch must lower the error to this share of it, or it was the last."""

GROWN = "growth.toml"

_TIMED = 3


@dataclass(frozen=True)
class RolloutCost:
    """The measured time of one rollout on one core."""

    seconds: float

    @property
    def is_slow(self) -> bool:
        """Whether rollouts, and not learning, decide how long a pretraining takes."""
        return self.seconds >= SLOW_S

    def in_words(self, rollouts: int, processes: int = 0) -> str:
        """How long so many rollouts take on this computer, for a person."""
        cores = processes or usable_cores()
        total = self.seconds * rollouts / cores
        sooner = ", sooner if the error stops falling" if self.is_slow else ""
        return (
            f"a rollout takes {duration(self.seconds)}; up to {rollouts} of them on {cores} cores take about "
            f"{duration(total)}{sooner}"
        )


def measured_cost(task: Task, seed: int) -> RolloutCost:
    """The median time of a few rollouts, one after another, in this process."""
    requests = draw_requests(task, _TIMED, np.random.default_rng(seed))
    times = []
    for i in range(_TIMED):
        p, c, a, n = (getattr(requests, name)[i] for name in ("parameters", "context", "action", "nuisance"))
        began = time.perf_counter()
        if task.simulate_many is None:
            task.simulate(p, c, a, n)
        else:
            task.simulate_many(p[None], c[None], a[None], n[None])
        times.append(time.perf_counter() - began)
    return RolloutCost(float(np.median(times)))


def duration(seconds: float) -> str:
    """A time for a person: "0.4 s", "12 min", "3.2 h"."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.2g} ms"
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"


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

    The sizes and errors are kept in `GROWN`, so that an interrupted run goes on.
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
