"""A checkpoint for an own object from the shipped one. Its networks are used as they are, or trained further for
another scene.

The shipped emulator has learnt the whole margin. An object that only has narrower ranges lies inside it, so the
networks cover it, and only the reward table is made again. An object of another size or mass is another scene. Then the
networks start from the shipped ones and learn from a third of the rollouts.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.adaptation.checkpoint import Checkpoint, save_checkpoint
from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.errors import CheckpointError
from sim.research.pretraining.budget import PretrainBudget
from sim.research.pretraining.dataset_share import stage_seeds
from sim.rollouts.dataset import build_dataset, draw_requests
from sim.rollouts.run import StageProgress, run_many
from sim.solvers.emulator.network import Emulator, rescaled_to
from sim.solvers.emulator.training import EmulatorSettings, held_out_errors, train_emulator
from sim.tasks.task import Solver, Task

HELD_OUT = 192
"""Fresh rollouts over the object's margin that judge the networks."""

LEARNING_RATE = 5e-4
"""A third of the rate for untrained networks, so that the networks do not forget what they know."""


@dataclass(frozen=True)
class HeldOutErrors:
    """The error of an emulator over the margin of an object, by rollouts that it has not learnt from."""

    rollouts: int
    accuracy: float  # of success or failure
    position_error_median: float  # last observed position, in state units
    end_state_error_median: float | None  # of successes, in units; None without one


def is_inside(task: Task, shipped: Task) -> bool:
    """Whether all rollouts of an object are among those that the shipped emulator learnt from."""
    covered = all(
        space.contains(values)
        for ours, space in ((task.margin, shipped.margin), (task.nuisance, shipped.nuisance))
        for values in (ours.low, ours.high)
    )
    return task.scene is None and covered


def rollouts_of(task: Task, shipped: Task, count: int | None = None) -> int:
    """The number of rollouts for learning an object: `count`, or a third of the usual number; 0 if nothing is to be
    learnt.
    """
    if task.exact is not None or is_inside(task, shipped):
        return 0
    budget = PretrainBudget.small(task)
    return count or budget.rollouts + budget.denser


def make_ready(
    task: Task,
    shipped: Checkpoint,
    folder: Path,
    seed: int,
    executor: Executor,
    progress: StageProgress,
    rollouts: int | None = None,
    table_settings: RewardTableSettings | None = None,
    held_out: int = HELD_OUT,
) -> tuple[Path, HeldOutErrors | None]:
    """Write the checkpoint of an object into `folder`. If the object is not inside the margin, its networks learn from
    `rollouts` rollouts.

    The error is None for a task that is solved exactly. Raises CheckpointError if the shipped checkpoint has no
    emulator for it, DatasetError.
    """
    draws, emulator, accuracy = stage_seeds(seed), None, None
    facts: dict[str, Any] = {"seed": seed, "start": shipped.sha256}
    if task.exact is None:
        emulator = _learnt(task, shipped, folder, draws, executor, progress, rollouts)
        accuracy = _accuracy(emulator, held_out, draws[3], executor, progress)
        facts["held_out"] = {name: value for name, value in asdict(accuracy).items() if value is not None}
    solver = emulator or _exact(task)
    reward_table = tabulate_rewards(solver, draws[2], table_settings, _stage("reward table", progress))
    return save_checkpoint(task, folder / "checkpoint", emulator, {}, facts, reward_table), accuracy


def _exact(task: Task) -> Solver:
    assert task.exact is not None
    return task.exact(task)


def _learnt(
    task: Task,
    shipped: Checkpoint,
    folder: Path,
    draws: tuple[int, ...],
    executor: Executor,
    progress: StageProgress,
    rollouts: int | None,
) -> Emulator:
    if shipped.emulator is None:
        raise CheckpointError(f"{shipped.path} holds no emulator: `adaptsim pretrain --object` makes a checkpoint")
    start = rescaled_to(shipped.emulator, task)
    count = rollouts_of(task, shipped.solver.task, rollouts)
    if not count:
        return start
    dataset = build_dataset(task, folder / "dataset", count, draws[0], executor, _stage("dataset", progress))
    settings = replace(EmulatorSettings(), learning_rate=LEARNING_RATE)
    return train_emulator(task, dataset, draws[1], settings, _stage("emulator", progress), start)[0]


def _accuracy(emulator: Emulator, count: int, seed: int, executor: Executor, progress: StageProgress) -> HeldOutErrors:
    """The error, measured by fresh rollouts."""
    requests = draw_requests(emulator.task, count, np.random.default_rng(seed))
    true = run_many(emulator.task, requests, executor, _stage("held-out rollouts", progress))
    errors = held_out_errors(emulator, requests, true)
    ends = errors["end_state_error_median"]
    return HeldOutErrors(
        rollouts=count,
        accuracy=float(errors["accuracy"].mean()),
        position_error_median=float(np.median(errors["position_error_median"])),
        end_state_error_median=float(np.median(ends)) if len(ends) else None,
    )


def _stage(name: str, progress: StageProgress) -> Any:
    return lambda done, total: progress(name, done, total)
