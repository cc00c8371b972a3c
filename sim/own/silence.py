"""Ends a process in which the code of a task's file hangs or crashes, and reads afterwards where it was.

The timer and the record are those of `faulthandler`: they also work while compiled code holds the interpreter.
"""

from __future__ import annotations

import faulthandler
import re
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any

from sim.tasks.task import Task

_FRAME = re.compile(r'^ +File "(.*)", line (\d+) in ', re.MULTILINE)
_TIMEOUT = re.compile(r"^Timeout \(", re.MULTILINE)
_FATAL = re.compile(r"^Fatal Python error: (.*)$", re.MULTILINE)


class StepTimer:
    """Ends this process if a step takes longer than its limit. `record` says which step and where; see `ending`."""

    def __init__(self, record: Path) -> None:
        self._file = record.open("w", encoding="utf-8")
        faulthandler.enable(self._file)

    def begin(self, step: str, limit_s: float) -> None:
        """Begin a step, which ends with the next one."""
        self._file.seek(0)
        self._file.truncate()
        self._file.write(f"{limit_s} {step}\n")
        self._file.flush()
        faulthandler.dump_traceback_later(limit_s, exit=True, file=self._file)

    def end(self) -> None:
        """The last step has ended."""
        faulthandler.cancel_dump_traceback_later()
        faulthandler.disable()
        self._file.close()

    def watching(self, task: Task, limit_s: float) -> Task:
        """The task, each of whose rollouts and trainings is a step."""

        def announced(function: Callable[..., Any], step: Callable[..., str], most_s: float) -> Callable[..., Any]:
            @wraps(function)
            def watched(*values: Any, **named: Any) -> Any:
                self.begin(step(*values), most_s)
                return function(*values, **named)

            return watched

        def one(parameters: Any, *rest: Any) -> str:
            return f"a rollout with {task.parameters.in_words(parameters)}"

        def stack(parameters: Any, *rest: Any) -> str:
            return f"a call of the batched function with {len(parameters)} rollouts"

        changed: dict[str, Any] = {"simulate": announced(task.simulate, one, limit_s)}
        if task.simulate_many is not None:
            changed["simulate_many"] = announced(task.simulate_many, stack, limit_s)
        if task.training is not None:
            train, most_s = task.training.train, max(limit_s, task.training.time_limit_s)
            changed["training"] = replace(
                task.training, train=announced(train, lambda *values: "the training of a policy", most_s)
            )
        return replace(task, **changed)


@dataclass(frozen=True)
class Ending:
    """How a process ended before its work was done."""

    step: str
    limit_s: float
    line: int | None  # of the task's file
    timed_out: bool
    cause: str  # of a crash


def ending(record: Path, path: str, status: int) -> Ending:
    """The end of a process by its record and exit status; `path` is the task's file."""
    first, _, trace = record.read_text(encoding="utf-8", errors="replace").partition("\n")
    limit, _, step = first.partition(" ")
    ascii_path = path.encode("ascii", "backslashreplace").decode()
    lines = [int(number) for file, number in _FRAME.findall(trace) if file == ascii_path]
    fatal = _FATAL.search(trace)
    if fatal is not None:
        cause = fatal[1]
    else:
        cause = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit code {status}"
    return Ending(step, float(limit or 0.0), lines[0] if lines else None, _TIMEOUT.search(trace) is not None, cause)
