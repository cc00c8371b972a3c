"""Solvers that simulate when they are asked, by name; each is imported on first use (the emulator is the usual one)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from sim.solvers.solver import Solver
from sim.tasks.task import Task

SIMULATING = {"naf": "sim.research.naf.solver"}
"""Name -> the module that makes it."""


class Simulating(Protocol):
    """What such a module offers."""

    def restore(self, task: Task, facts: Mapping[str, Any]) -> Solver:
        """The solver of a checkpoint whose card has the table `facts`; it stores nothing, and runs rollouts one by one.

        Raises KeyError, TypeError or ValueError if the table is damaged.
        """

    def in_session(
        self, task: Task, facts: Mapping[str, Any] | None, workers: int, folder: Path
    ) -> AbstractContextManager[Solver]:
        """The solver of a session, on `workers` processes (0: one per core), which stores what it learns in `folder`.

        `facts` is the table of the checkpoint's card; None: the task's own settings. Raises UnknownName for a task
        without them, CheckpointError if `folder` holds other data.
        """


def simulating(name: str) -> Simulating:
    """The module of a solver in `SIMULATING`."""
    return cast("Simulating", import_module(SIMULATING[name]))
