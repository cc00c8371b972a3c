"""The process that loads and examines a task: TASK LIMIT FOLDER PARENT. See `task_check.checked`."""

from __future__ import annotations

import json
import os
import sys
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.research.task_check import RECORD, RESULT, loaded
from hw.watchdog import die_with_parent
from sim.errors import SimError, TaskError
from sim.own.silence import StepTimer
from sim.own.watching import watched
from sim.rollouts.sampled_rollouts import Cost, TaskFinding
from sim.rollouts.soundness import examine
from sim.tasks.files import is_file, line_of

LOADING_S, STEP_S = 60.0, 20.0
"""The least time limits: for loading the file and for the steps between rollouts, and for one rollout. On a busy
computer, imports of large packages take long."""


def examined(name_or_file: str, limit_s: float, watchdog: StepTimer) -> dict[str, Any]:
    """The findings about a task and the cost of a rollout. A file that cannot be loaded raises TaskError.

    Each step may take half of `limit_s`, so a task with longer rollouts cannot be checked in that time.
    """
    costs, findings = list[Cost](), list[TaskFinding]()
    path = Path(name_or_file.partition(":")[0]).expanduser().absolute()
    loading_s, step_s = max(LOADING_S, limit_s / 2), max(STEP_S, limit_s / 2)
    with watched(str(path)) if is_file(name_or_file) else nullcontext() as notes:
        watchdog.begin("loading the file", loading_s)
        task = loaded(name_or_file)
        try:
            for finding in examine(watchdog.watching(task, step_s), np.random.default_rng(0), limit_s, costs.append):
                findings.append(finding)
                watchdog.begin("a function of the task", loading_s)
        except SimError as error:
            findings.append(TaskFinding("every rollout can be simulated", "broken", str(error)))
    if notes is not None:
        asides = [*notes.sentences()]
        findings += [TaskFinding(f"the file {what}", "doubtful", sentence) for what, sentence in asides]
        if not asides:
            findings.append(TaskFinding("the file only computes", "kept"))
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


def main(name_or_file: str, limit: str, folder: str, parent: str) -> None:
    """Write the findings, or the error, into the folder."""
    if sys.platform == "linux":
        die_with_parent(int(parent))
    watchdog = StepTimer(Path(folder) / RECORD)
    try:
        answer = examined(name_or_file, float(limit), watchdog)
    except SimError as error:
        answer = {"error": type(error).__name__, "message": str(error)}
    except BaseException as error:  # noqa: BLE001 - a task may raise even an interrupt
        where = line_of(error, str(Path(name_or_file.partition(":")[0]).expanduser().absolute()))
        answer = {"error": TaskError.__name__, "message": f"{where}: {type(error).__name__}: {error}"}
    watchdog.end()
    temporary = Path(folder) / f"{RESULT}.part"
    temporary.write_text(json.dumps(answer), encoding="utf-8")
    temporary.replace(Path(folder) / RESULT)
    sys.stderr.flush()
    os._exit(0)  # threads of the task may still run


if __name__ == "__main__":
    main(*sys.argv[1:])
