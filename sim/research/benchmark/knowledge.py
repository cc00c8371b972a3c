"""The parameter ranges that a method knows: only Omega, or Omega with its margin.

Drawn worlds take their parameters from both. A comparison is about methods only if all of them have the same knowledge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.solvers.candidates import PredictionsBehind
from sim.solvers.emulator.network import Emulator
from sim.tasks.own_object import task_of_object
from sim.tasks.task import Executable, SolvedPolicy, Solver, SolverSettings, Task
from sim.types import Space

Ranges = Literal["omega", "margin"]
"""With `omega`, a method considers no parameters beyond Omega. With `margin`, the whole margin counts as Omega."""

RANGES: tuple[Ranges, ...] = get_args(Ranges)

TRUTHS = 1024
"""Number of candidate truths of the reward table in other ranges, as many as `adaptsim` weighs."""


@dataclass(frozen=True, eq=False)
class RangedSolver(PredictionsBehind):
    """A `Solver` whose task has other ranges. Its policies also come from the solver behind it."""

    behind: Solver

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[SolvedPolicy, ...]:
        """See `sim.tasks.task.Policies`."""
        return self.behind.policies(samples, rng, executable, settings)


def with_ranges(checkpoint: Checkpoint, ranges: Ranges, *, tabulated: bool = True) -> Checkpoint:
    """The checkpoint for methods that know these ranges. Its reward table is computed again, or left out."""
    task = _with_ranges(checkpoint.solver.task, ranges)
    behind: Any = checkpoint.solver
    solver: Solver = RangedSolver(task, behind) if isinstance(behind, Emulator) else replace(behind, task=task)
    reward_table = None
    if tabulated and checkpoint.reward_table is not None:
        reward_table = tabulate_rewards(solver, 0, RewardTableSettings(truths=TRUTHS))
    return replace(checkpoint, solver=solver, reward_table=reward_table)


@lru_cache(maxsize=8)
def checkpoint_knowing(
    task: str, name: str, ranges: Ranges | None, *, own_object: str = "", tabulated: bool = True
) -> Checkpoint:
    """The checkpoint `name` of a task, or of its object in the file `own_object`. It keeps its own ranges if none are
    named. Raises ObjectError, CheckpointError.
    """
    checkpoint = load_checkpoint(task_of_object(task, own_object), name)
    return checkpoint if ranges is None else with_ranges(checkpoint, ranges, tabulated=tabulated)


def _with_ranges(task: Task, ranges: Ranges) -> Task:
    if ranges == "margin":
        return replace(task, parameters=task.margin)
    closed = (replace(d, margin=None, limits=None) for d in task.parameters.dimensions)
    return replace(task, margin=Space(tuple(closed)))
