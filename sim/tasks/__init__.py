"""Every task by name: the only place that lists them. Each is imported when first asked for."""

from __future__ import annotations

from importlib import import_module

from sim.errors import UnknownName
from sim.tasks.task import Task

TASKS = {
    "pendulum": "sim.tasks.pendulum",
    "pushing": "sim.tasks.pushing",
    "scooping": "sim.tasks.scooping",
}
"""Name -> the module whose `TASK` it is."""


def get_task(name: str) -> Task:
    """The task called `name`. Raises UnknownName."""
    if name not in TASKS:
        raise UnknownName(f'task "{name}" is not known: it must be one of {", ".join(TASKS)}')
    task: Task = import_module(TASKS[name]).TASK
    return task
