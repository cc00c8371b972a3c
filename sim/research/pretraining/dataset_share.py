"""The plan of a pretraining: its stages, their seeds, and the shares of its dataset."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hw.bounded import Unreadable
from sim.errors import DatasetError
from sim.research.pretraining.budget import PretrainBudget
from sim.rollouts.dataset import AdaptiveSampling, build_share
from sim.rollouts.run import StageProgress
from sim.rollouts.shares import Share
from sim.solvers.emulator.training import outcome_variance
from sim.storage.files import read_toml, write_toml
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

STAGES = ("dataset", "emulator", "reward table", "adaptation policies", "evaluation", "checkpoint")


def simulate_dataset_share(
    task: Task,
    folder: Path,
    budget: PretrainBudget,
    seed: int,
    share: Share,
    executor: Executor,
    progress: StageProgress,
) -> bool:
    """Simulate one share of the dataset that `pretrain` learns from; several processes may do so at a time.

    Returns whether the share is complete: False while the denser part waits for other shares of the first. Only for a
    task with a dataset, that is for the solver emulator. Raises DatasetError if the folder holds another plan.
    """
    agree_on_plan(task, folder, budget, seed, "emulator")
    seeds = stage_seeds(seed)
    return build_share(
        task,
        folder / "dataset",
        budget.rollouts,
        seeds[0],
        share,
        executor,
        lambda i, n: progress(STAGES[0], i, n),
        denser(task, budget, seeds[1]),
    )


def denser(task: Task, budget: PretrainBudget, seed: int) -> AdaptiveSampling | None:
    """The denser part of the dataset, where the outcome is uncertain; None without one."""
    return AdaptiveSampling(budget.denser, partial(outcome_variance, task, seed)) if budget.denser else None


def stage_seeds(seed: int) -> tuple[int, ...]:
    """Seeds of dataset, emulator, adaptation policies and evaluation."""
    return tuple(int(s.generate_state(1)[0]) for s in np.random.SeedSequence(seed).spawn(4))


def agree_on_plan(task: Task, folder: Path, budget: PretrainBudget, seed: int, solver: str) -> None:
    """Write the plan of a folder, or compare it with the one there. Raises DatasetError if they differ."""
    drawn = {"seed": seed, "solver": solver, "budget": asdict(budget)}
    plan = {"task": task.name, "fingerprint": fingerprint(task), **drawn}
    path = folder / "plan.toml"
    if not path.exists():
        write_toml(path, plan)
        return
    before = read_report(path)
    different = [key for key, value in plan.items() if before.get(key) != value]
    if different:
        raise DatasetError(
            f"{folder} was begun with a different {', '.join(different)}: use a new folder, or the settings in {path}"
        )


def read_report(path: Path) -> dict[str, Any]:
    """Read a TOML file of the folder. Raises DatasetError."""
    try:
        return read_toml(path)
    except (FileNotFoundError, Unreadable) as error:
        raise DatasetError(f"{path} {error}: remove it, or begin in a new folder") from error
