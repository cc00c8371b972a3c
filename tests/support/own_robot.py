"""A robot of one's own for tests: the toy task, and small programs that answer for it."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from toy_rig import TASK, ToyLab, toy_parts
from toy_session import resolved, silent

from adaptsim_cli.config import Config
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session import running
from adaptsim_cli.session.own.exchange import Answerer
from adaptsim_cli.session.own.program import Program
from adaptsim_cli.session.own.target import OwnTarget
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.show import page
from perception.types import Outcome
from sim.tasks.task import LabReport, Task

NAME = "toy-own"
REPORT = LabReport(
    columns=("x [m]", "y [m]", "z [m]"),
    outcomes=(Outcome.ON_BLADE, Outcome.ON_TABLE),
    successes=(Outcome.ON_BLADE,),
    ends_in_tool=True,
)
PUSHED = replace(TASK, report=REPORT)
PLACED = replace(TASK, report=replace(REPORT, places_first=True))

ROBOT = """
import json, sys
q = json.load(sys.stdin)
print("[INFO] [robot]: hello")
with open(RUNS, "a") as runs:
    runs.write(f"{q['ask']} {q['trial']}.{q['attempt']}\\n")
if q["ask"] == "place":
    print(json.dumps({"trial": q["trial"], "context": {k: v + 0.001 for k, v in q["context"].items()}}))
else:
    x, y = list(q["context"].values())
    times = [0.1 * i for i in range(12)]
    state = [[x + 0.01 * min(t, 0.8), y, 0.02] for t in times]
    a = list(q["action"].values())[0]
    print(json.dumps({"trial": q["trial"], "t_s": times, "state": state, "outcome": "on_blade", "rest_s": 0.8,
                      "end_in_tool_m": [-0.01 - 0.02 * a, 0.0, 0.02]}))
"""
"""Answers everything, and notes each of its runs in the file RUNS."""


def command_of(file: Path) -> str:
    """The command line of a Python program: without packages it starts at once."""
    return shlex.join([sys.executable, "-S", "-E", str(file)])


def robot(folder: Path, body: str = ROBOT) -> str:
    """The command of a program with this text, in which RUNS is a file of the folder."""
    file = folder / "robot.py"
    file.write_text(f"RUNS = {str(folder / 'runs.txt')!r}\n{body}")
    return command_of(file)


def runs(folder: Path) -> list[str]:
    """What the program was asked, run by run."""
    file = folder / "runs.txt"
    return file.read_text().splitlines() if file.exists() else []


def opener(answerer: Answerer, task: Task = PUSHED) -> Callable[..., Any]:
    """Opens the parts of a session of the toy task with a robot of one's own."""

    @contextmanager
    def open_parts(config: Config, learnt: Path, **_: object) -> Iterator[SessionParts]:
        target = OwnTarget.of_session(task, learnt.parent, answerer, config.method)
        parts = toy_parts(ToyLab(0), calibration="", calibration_sha256="", world_sha256="")
        yield replace(parts, task=task, target=target)

    return open_parts


def program(command: str, **changes: Any) -> Program:
    """A program that moves nothing."""
    return Program(command, False, 20.0, None, Release(), **changes)


def run(home: Path, answerer: Answerer, task: Task = PUSHED, iterations: int = 1) -> SessionStore:
    """`run-iteration --hw own --yes` on the toy task."""
    settings = resolved(home, hw="own", answer_with="a program")
    request = running.SessionRequest(None, frozenset({"task"}), iterations, yes=True)
    running.run_session(settings, request, opener(answerer, task), page.write, silent())
    return SessionStore.open(settings.places.sessions, NAME)


def answer(**changes: Any) -> dict[str, Any]:
    """A good answer to trial 1, with these keys changed; None removes one."""
    times = [0.1 * i for i in range(12)]
    table = {
        "trial": 1,
        "t_s": times,
        "state": [[0.68 + 0.01 * t, 0.0, 0.02] for t in times],
        "outcome": "on_blade",
        "end_in_tool_m": [-0.02, 0.0, 0.02],
    }
    return {key: value for key, value in {**table, **changes}.items() if value is not None}


def printing(table: Any) -> str:
    """A program that prints this as JSON."""
    return f"print({json.dumps(table)!r})"
