"""The settings of a command: the world may decide the task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from adaptsim_cli import config
from adaptsim_cli.bench.checkpoints import resolve
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import UsageError

_WORLD = "world "
"""First word of the origin of a task that the world decides."""


def load(flags: Mapping[str, Any]) -> Resolved:
    """Load the settings; the world decides the task if its name comes from closer to the command line.

    Raises UsageError, also if several tasks have a world of that name and the settings name none of these tasks,
    UnknownName or WorldError for a world that no task has.
    """
    resolved = resolve(flags)
    settings, sources = resolved.config, resolved.sources
    if not settings.is_simulated or _rank(resolved, sources["world"]) <= _rank(resolved, sources["task"]):
        return resolved
    from sim.lab.world import load_world, tasks_of_world
    from sim.tasks import get_task

    tasks = tasks_of_world(settings.world)
    if not tasks:
        load_world(settings.world, get_task(settings.task))
    if len(tasks) != 1:
        if settings.task in tasks:
            return resolved
        raise UsageError(f"--world {settings.world}: there is one for {' and one for '.join(tasks)}; add --task")
    chosen = settings.model_copy(update={"task": tasks[0]})
    return replace(resolved, config=chosen, sources={**sources, "task": _WORLD + settings.world})


def named_by_flags(resolved: Resolved) -> frozenset[str]:
    """The settings that flags name, with the task that their world decides."""
    decided = resolved.sources["task"].startswith(_WORLD)
    return resolved.flags | {"task"} if decided else resolved.flags


def _rank(resolved: Resolved, source: str) -> int:
    """How close to the command line a setting comes from."""
    files = ("default", str(resolved.places.user_file), str(resolved.places.project_file))
    if source in files:
        return files.index(source)
    return len(files) + (source == config.FLAG)
