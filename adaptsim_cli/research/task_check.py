"""Loads a task by name or file, and checks what every task must keep, in a process of its own."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.errors import SimError
    from sim.tasks.task import Task

_MODULE = "adaptsim_cli.research.task_examination"
RESULT, RECORD = "result.json", "record.txt"
"""The files of the other process: its findings, and the step that it has reached."""

_MORE, _MOST_S = 10.0, 3600.0
"""The factor by which a message suggests a longer limit, and the longest limit that the command takes."""


def loaded(name_or_file: str) -> Task:
    """The task of that name, or of that file, whose name finds it from now on. Raises UnknownName, TaskError."""
    from sim.tasks import get_task, task_of_file
    from sim.tasks.files import is_file

    return task_of_file(name_or_file) if is_file(name_or_file) else get_task(name_or_file)


def checked(name_or_file: str, limit_s: float) -> dict[str, Any]:
    """The findings about a task and the cost of a rollout, for JSON.

    Raises TaskError, UnknownName if it cannot be loaded; TaskError naming the line if its code hangs or crashes.
    """
    from hw.child import python_module

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arguments = name_or_file, str(limit_s), name, str(os.getpid())
        process = subprocess.Popen(  # its output is the task's own, so it goes to stderr
            [*python_module(_MODULE), *arguments], stdin=subprocess.DEVNULL, stdout=2, start_new_session=True
        )
        try:
            _wait_without_reaping(process)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)  # with everything that it started
            status = process.wait()
        if not (folder / RESULT).exists():
            raise _early_end(name_or_file, folder / RECORD, status, limit_s)
        answer: dict[str, Any] = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    if "error" in answer:
        import sim.errors

        raise getattr(sim.errors, answer["error"])(answer["message"])
    return answer


def _wait_without_reaping(process: subprocess.Popen[bytes]) -> None:
    """Wait for the end of the process without reaping it, so that its number, which is that of its group, goes to no
    other process.
    """
    if hasattr(os, "waitid"):
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    else:
        process.wait()


def _early_end(name_or_file: str, record: Path, status: int, limit_s: float) -> SimError:
    from sim.errors import TaskError
    from sim.own.silence import ending
    from sim.tasks.files import is_file, registered

    entry = registered().get(name_or_file)
    path = entry.file if entry is not None else name_or_file.partition(":")[0]
    is_declared = entry is not None or is_file(name_or_file)
    file = str(Path(path).expanduser().absolute()) if is_declared else f"the task {name_or_file}"
    if not record.exists():
        return TaskError(f"{file}: the process of the check ended before it began ({status}): run the command again")
    end = ending(record, file, status)
    where = f"{file}, line {end.line}" if end.line is not None else file
    if end.timed_out:
        more_s = min(_MOST_S, max(_MORE * limit_s, 4.0 * end.limit_s))
        again = f"adaptsim task check {shlex.quote(name_or_file)} --limit {more_s:g}"
        return TaskError(
            f"{where}: {end.step} has not ended after {end.limit_s:g} s. Correct this line; if it only needs more "
            f"time: {again}"
        )
    return TaskError(f"{where}: {end.step} ended the process ({end.cause}): correct this line")


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
