"""Every task by name: ours, and those of installed packages. Each is imported on first use.

A package offers a task by an entry point of the group `adaptsim.tasks`: the task's name, and the module with its
`TASK`. Beside that module there may be folders `worlds` and `checkpoints`.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Literal

from hw.plugins import Registry
from sim.errors import UnknownName
from sim.tasks.task import Task

TASKS = {
    "pendulum": "sim.tasks.pendulum",
    "pushing": "sim.tasks.pushing",
    "scooping": "sim.tasks.scooping",
}
"""Name -> module with the `TASK`, for our tasks."""


def _ours(module: str) -> Task:
    task: Task = import_module(module).TASK
    return task


def _complaint(name: str, task: object) -> str:
    if isinstance(task, Task):
        return "" if task.name == name else f'is called "{task.name}"; both names must agree'
    return f"is a {type(task).__name__}, not a Task"


REGISTRY = Registry[Task]("task", "adaptsim.tasks", "TASK", TASKS, UnknownName, _ours, _complaint)


def task_names() -> tuple[str, ...]:
    """Names of our tasks, then of those of installed packages."""
    return REGISTRY.names()


def get_task(name: str) -> Task:
    """The task called `name`. Raises UnknownName."""
    return REGISTRY.get(name)


def files_of(name: str, kind: Literal["worlds", "checkpoints"]) -> Path:
    """The folder of the files that ship with task `name`; it need not exist. No task is imported."""
    offer = REGISTRY.offer(name)
    if offer is not None and (origin := offer.origin()) is not None:
        return origin.parent / kind
    return Path(__file__).parents[1] / kind / name
