"""Every task by name: ours, and those of installed packages. Each is imported on first use.

A package offers a task by an entry point of the group `adaptsim.tasks`: the task's name, and the module with its
`TASK`. Beside that module there may be folders `worlds` and `checkpoints`.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from sim.errors import UnknownName, did_you_mean
from sim.tasks.task import Task

TASKS = {
    "pendulum": "sim.tasks.pendulum",
    "pushing": "sim.tasks.pushing",
    "scooping": "sim.tasks.scooping",
}
"""Name -> module with the `TASK`, for our tasks."""

OFFERED = "adaptsim.tasks"
"""The group of entry points by which packages offer tasks."""


def task_names() -> tuple[str, ...]:
    """Names of our tasks, then of those of installed packages."""
    return (*TASKS, *sorted(_installed()))


def get_task(name: str) -> Task:
    """The task called `name`. Raises UnknownName."""
    return _ours(name) if name in TASKS else _theirs(name)


def files_of(name: str, kind: Literal["worlds", "checkpoints"]) -> Path:
    """The folder of the files that ship with task `name`; it need not exist. No task is imported."""
    if name not in TASKS and (module := _installed().get(name)) is not None:
        try:
            spec = find_spec(module)
        except ImportError:  # in a parent package; `get_task` reports it
            spec = None
        if spec is not None and spec.origin is not None:
            return Path(spec.origin).parent / kind
    return Path(__file__).parents[1] / kind / name


def _ours(name: str) -> Task:
    task: Task = import_module(TASKS[name]).TASK
    return task


def _theirs(name: str) -> Task:
    if (module := _installed().get(name)) is None:
        raise UnknownName(
            f'task "{name}" is not known: it must be one of {", ".join(task_names())}{did_you_mean(name, task_names())}'
        )
    try:
        task = import_module(module).TASK
    except (ImportError, AttributeError) as error:
        raise UnknownName(f'task "{name}" is offered by {module}, which does not hold it: {error}') from error
    if not isinstance(task, Task) or task.name != name:
        called = f'is called "{task.name}"' if isinstance(task, Task) else f"is a {type(task).__name__}"
        raise UnknownName(f'task "{name}" is offered by {module}, whose TASK {called}: both names must agree')
    return task


@cache
def _installed() -> dict[str, str]:
    """Name -> module of installed packages, except names of our own tasks."""
    return {entry.name: entry.value for entry in entry_points(group=OFFERED) if entry.name not in TASKS}
