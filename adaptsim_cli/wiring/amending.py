"""The parts for judging a stored trial again: the session's task and its possible outcomes."""

from __future__ import annotations

from adaptsim_cli.config import Config
from adaptsim_cli.devices.trackers import tracker_of
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.records import Facts
from adaptsim_cli.wiring.checkpoints import task_of
from perception.types import Outcome
from sim.tasks.task import Task


def seen_by_camera(config: Config, facts: Facts) -> tuple[Task, tuple[Outcome, ...]]:
    """The task with the session's ranges, and its outcomes. Raises UsageError for a task without a camera."""
    task = task_of(config.model_copy(update={"task": facts.task, "object": facts.object}))
    if task.hardware is None or not facts.calibration:
        raise UsageError(f"session {facts.name} was simulated without a camera: its outcomes are exact")
    return task, tracker_of(task).outcomes
