"""Joins a checkpoint with rollouts of its task, to see whether its card holds."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from adaptsim_cli.config import Config
from sim.tasks.task import Task

ROLLOUTS, QUICK = 240, 96
"""True rollouts of a re-evaluation: half a minute of one core, and some ten seconds."""


def task_of(config: Config) -> Task:
    """The task of the settings, with the ranges of an own object. Raises UnknownName, ObjectError."""
    from sim.own_objects import load_object, with_ranges
    from sim.tasks import get_task

    task = get_task(config.task)
    return with_ranges(task, load_object(Path(config.object))) if config.object else task


def reevaluate(config: Config, rollouts: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Load the setting's checkpoint against card and task, and see whether the card's figures hold; for JSON.

    Raises CheckpointError where it is corrupt or foreign; a figure that does not hold is told in `holds`.
    """
    from sim.adaptation.reevaluation import Figure, reevaluate
    from sim.checkpoint import load_checkpoint
    from sim.rollouts import process_pool, run_many

    task = task_of(config)
    checkpoint = load_checkpoint(task, config.checkpoint or "default")
    figures: list[Figure] = []
    if rollouts:
        with process_pool(config.workers or None) as executor:
            figures = reevaluate(
                checkpoint, partial(run_many, task, executor=executor), rollouts, config.seed, progress
            )
    return {
        "task": task.name,
        "folder": str(checkpoint.path),
        "sha256": checkpoint.sha256,
        "holds": all(f.holds for f in figures),
        "figures": [
            {
                "name": f.name,
                "card": f.card,
                "found": f.found,
                "tolerance": f.tolerance,
                "better": f.better,
                "holds": f.holds,
            }
            for f in figures
        ],
    }
