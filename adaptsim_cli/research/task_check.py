"""Loads a task by name or file, and checks what every task must keep."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.rollouts.sampled_rollouts import Cost
    from sim.tasks.task import Task


def loaded(name_or_file: str) -> Task:
    """The task of that name, or of that file, whose name finds it from now on. Raises UnknownName, TaskError."""
    from sim.tasks import get_task, task_of_file
    from sim.tasks.files import is_file

    return task_of_file(name_or_file) if is_file(name_or_file) else get_task(name_or_file)


def checked(name_or_file: str, limit_s: float) -> dict[str, Any]:
    """The findings about a task and the cost of a rollout, for JSON. A file that cannot be loaded raises TaskError."""
    from contextlib import nullcontext
    from pathlib import Path

    import numpy as np

    from sim.errors import SimError
    from sim.own.watching import watched
    from sim.rollouts.sampled_rollouts import TaskFinding
    from sim.rollouts.soundness import examine
    from sim.tasks.files import is_file

    costs, findings = list[Any](), list[TaskFinding]()

    def timed(cost: Cost) -> None:
        costs.append(cost)

    path = Path(name_or_file.partition(":")[0]).expanduser().absolute()
    with watched(str(path)) if is_file(name_or_file) else nullcontext() as notes:
        task = loaded(name_or_file)
        try:
            findings += examine(task, np.random.default_rng(0), limit_s, timed)
        except SimError as error:
            findings.append(TaskFinding("every rollout can be simulated", "broken", str(error)))
    if notes is not None:
        asides = [*notes.sentences()]
        findings += [TaskFinding(f"the file {what}", "doubtful", sentence) for what, sentence in asides]
        if not asides:
            findings.append(TaskFinding("the file neither prints, nor sleeps, nor starts a process", "kept"))
    cost = costs[0] if costs else None
    return {
        "task": task.name,
        "file": None if task.file is None else task.file.path,
        "sound": all(one.mark != "broken" for one in findings),
        "findings": [asdict(one) for one in findings],
        "rollouts": 0 if cost is None else cost.rollouts,
        "median_s": None if cost is None else cost.median_s,
        "longest_s": None if cost is None else cost.longest_s,
    }


def described(task: Task) -> dict[str, Any]:
    """The interface of a task, for JSON."""
    from sim.lab.world import list_worlds
    from sim.tasks.fingerprint import describe, fingerprint

    o = task.observation
    names = o.curves or tuple(f"column {c}" for c in o.columns)
    return {
        "task": task.name,
        "title": task.title,
        "file": None if task.file is None else task.file.path,
        "sha256": None if task.file is None else task.file.sha256,
        "physics": task.physics,
        "fingerprint": fingerprint(task),
        "duration_s": float(o.times_s[-1]),
        "times_s": [float(t) for t in o.times_s],
        "state": [(name, float(low), float(high)) for name, low, high in zip(names, o.low, o.high, strict=True)],
        **{role: describe(getattr(task, role)) for role in ("parameters", "margin", "context", "action", "nuisance")},
        "worlds": list(list_worlds(task)),
    }
