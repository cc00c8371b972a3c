"""Joins a checkpoint with rollouts of its task, to see whether its card holds."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from adaptsim_cli.config import Config
from sim.tasks.task import Task

ROLLOUTS, QUICK = 240, 96
"""True rollouts of a re-evaluation: of one core half a minute, and some ten seconds."""


def task_for(name: str, own: Path | None) -> Task:
    """The task, with the ranges of an own object's file if there is one. Raises UnknownName, ObjectError."""
    from sim.own_objects import load_object, with_ranges
    from sim.tasks import get_task

    task = get_task(name)
    return task if own is None else with_ranges(task, load_object(own))


def reevaluate(config: Config, own: Path | None, rollouts: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Load the setting's checkpoint against card and task, and see whether the card's figures hold; for JSON.

    Raises CheckpointError where it is corrupt or foreign; a figure that does not hold is told in `holds`.
    """
    from sim.adaptation.reevaluation import Figure, reevaluate
    from sim.checkpoint import load_checkpoint
    from sim.rollouts import process_pool, run_many, serial_executor

    task = task_for(config.task, own)
    checkpoint = load_checkpoint(task, config.checkpoint or "default")
    figures: list[Figure] = []
    if rollouts:
        with process_pool(config.workers) if config.workers > 1 else serial_executor() as executor:
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
