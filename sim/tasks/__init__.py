"""Every task by name: ours, and those of installed packages. Each is imported on first use.

A package offers a task by an entry point of the group `adaptsim.tasks`: the task's name, and the module with its
`TASK`. Beside that module there may be folders `worlds` and `checkpoints`. A file that declares tasks (`adaptsim.task`)
has to be named once by its path. Beside it there may be folders `worlds/<task>` and `checkpoints/<task>`.
"""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Literal

from hw.plugins import Registry, did_you_mean
from sim.errors import SimError, TaskError, UnknownName
from sim.tasks import files
from sim.tasks.task import Task, TaskFile

TASKS = {
    "pendulum": "sim.tasks.pendulum",
    "pushing": "sim.tasks.pushing",
    "scooping": "sim.tasks.scooping",
}
"""Name -> module with the `TASK`, for our tasks."""


REGISTRY = Registry[Task](
    label="task",
    group="adaptsim.tasks",
    attribute="TASK",
    ours=TASKS,
    error=UnknownName,
    value_type=Task,
    complaint=lambda name, task: "" if task.name == name else f'is called "{task.name}"; both names must agree',
)


def task_names() -> tuple[str, ...]:
    """Names of our tasks, then of those of installed packages, then of those of files."""
    return tuple(dict.fromkeys((*REGISTRY.names(), *files.registered())))


def get_task(name: str) -> Task:
    """The task called `name`. Raises UnknownName; TaskError if the file of a task is gone or wrong."""
    if name in REGISTRY:
        return REGISTRY.get(name)
    task = files.named(name)
    if task is None:
        names = task_names()
        raise UnknownName(
            f'task "{name}" is not known: it must be one of {", ".join(names)}{did_you_mean(name, names)}'
            "; a file of your own is named by its path, ending in .py"
        )
    return task


def known_task(name: str) -> Task | None:
    """The task called `name`, for words about a stored session; None if it is gone or cannot be loaded any more."""
    try:
        return get_task(name)
    except SimError:
        return None


def task_of_file(text: str) -> Task:
    """The task of `FILE.py` (or `FILE.py:NAME`), found by its name from now on. Raises TaskError."""
    name = files.chosen(text).name
    if name in REGISTRY:
        raise TaskError(
            f"{text} declares a task {name}, and there is another one of that name: call the function differently"
        )
    return files.register(text)


def files_of(name: str, kind: Literal["worlds", "checkpoints"]) -> Path:
    """The folder of the files that ship with task `name`; it need not exist. No task is imported."""
    offer = REGISTRY.offer(name)
    if offer is not None and (origin := offer.origin()) is not None:
        return origin.parent / kind
    if name not in REGISTRY.ours and (entry := files.registered().get(name)) is not None:
        return Path(entry.file).parent / kind / name
    return Path(__file__).parents[1] / kind / name


def declared_worlds(name: str) -> tuple[str, ...]:
    """The worlds that the file of a task declares. No task is imported."""
    entry = None if name in REGISTRY else files.registered().get(name)
    return () if entry is None else entry.worlds


def _rebuilt(name: str, file: TaskFile | None, changes: Mapping[str, Any]) -> Task:
    task = get_task(name) if file is None else files.of_file(file, name)
    return replace(task, **changes) if changes else task


def _reduced(task: Task) -> Any:
    """A task is sent to another process as its name and the fields that differ, because its functions may not be
    importable there.
    """
    try:
        usual = get_task(task.name) if task.file is None else files.of_file(task.file, task.name)
    except UnknownName:  # nobody can find it by name: as it is
        return object.__reduce_ex__(task, 2)
    pairs = ((f.name, getattr(task, f.name)) for f in fields(task))
    return _rebuilt, (task.name, task.file, {k: v for k, v in pairs if v is not getattr(usual, k)})


copyreg.pickle(Task, _reduced)
