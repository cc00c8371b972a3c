"""Every task by name: ours, and those of installed packages. Each is imported when first asked for.

A package offers a task with an entry point of the group `adaptsim.tasks`: its name, and the module whose `TASK` it is.
Beside that module may lie folders `worlds` and `checkpoints`.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from sim.errors import UnknownName
from sim.tasks.task import Task

TASKS = {
    "pendulum": "sim.tasks.pendulum",
    "pushing": "sim.tasks.pushing",
    "scooping": "sim.tasks.scooping",
}
"""Name -> the module whose `TASK` it is: ours."""

OFFERED = "adaptsim.tasks"
"""The group of entry points by which packages offer theirs."""


def task_names() -> tuple[str, ...]:
    """Ours, then those of installed packages."""
    return (*TASKS, *sorted(_installed()))


def get_task(name: str) -> Task:
    """The task called `name`. Raises UnknownName."""
    return _ours(name) if name in TASKS else _theirs(name)


def files_of(name: str, kind: Literal["worlds", "checkpoints"]) -> Path:
    """Folder of what ships with the task called `name`; it need not exist. No task is imported."""
    if name not in TASKS and (module := _installed().get(name)) is not None:
        try:
            spec = find_spec(module)
        except ImportError:  # of a package around it; `get_task` says so
            spec = None
        if spec is not None and spec.origin is not None:
            return Path(spec.origin).parent / kind
    return Path(__file__).parents[1] / kind / name


def _ours(name: str) -> Task:
    task: Task = import_module(TASKS[name]).TASK
    return task


def _theirs(name: str) -> Task:
    if (module := _installed().get(name)) is None:
        raise UnknownName(f'task "{name}" is not known: it must be one of {", ".join(task_names())}')
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
    """Name -> module. A name of ours stays ours."""
    return {entry.name: entry.value for entry in entry_points(group=OFFERED) if entry.name not in TASKS}
