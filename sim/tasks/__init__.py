"""Every task by name: ours, and those of installed packages. Each is imported on first use.

A package offers a task by an entry point of the group `adaptsim.tasks`: the task's name, and the module with its
`TASK`. Beside that module there may be folders `worlds` and `checkpoints`.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Literal

from hw.plugins import Offer, PluginError, clashes, offers
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
    offer = None if name in TASKS else _installed().get(name)
    if offer is not None and (origin := offer.origin()) is not None:
        return origin.parent / kind
    return Path(__file__).parents[1] / kind / name


def _ours(name: str) -> Task:
    task: Task = import_module(TASKS[name]).TASK
    return task


def clashing() -> tuple[str, ...]:
    """A sentence for each task of a package that cannot be used because of its name."""
    return clashes(OFFERED, set(TASKS))


def _theirs(name: str) -> Task:
    if (offer := _installed().get(name)) is None:
        raise UnknownName(
            f'task "{name}" is not known: it must be one of {", ".join(task_names())}{did_you_mean(name, task_names())}'
        )
    if twice := [sentence for sentence in clashing() if sentence.startswith(f"{name} of ")]:
        raise UnknownName(f"task {twice[0]}")
    try:
        task = offer.load("TASK")
    except PluginError as error:
        raise UnknownName(f"task {error}") from error
    if not isinstance(task, Task) or task.name != name:
        called = f'is called "{task.name}"' if isinstance(task, Task) else f"is a {type(task).__name__}"
        raise UnknownName(f"task {offer}: its TASK {called}; both names must agree")
    return task


def _installed() -> dict[str, Offer]:
    """Name -> offer of installed packages, except names of our own tasks."""
    return {offer.name: offer for offer in reversed(offers(OFFERED)) if offer.name not in TASKS}
