"""The rollouts of a grid, for tasks that are solved exactly: simulated at once, or one share of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path

from hw.types import Array
from sim.adaptation.checkpoint import GRID as GRID_TENSORS
from sim.rollouts.cost import measured_cost
from sim.rollouts.run import Requests, StageProgress
from sim.rollouts.shards import simulate_missing, simulate_share
from sim.rollouts.shards import split as into_shards
from sim.rollouts.shares import Share
from sim.solvers.candidates import ListedActionSolver
from sim.solvers.grid import GridSolver, grid_behind
from sim.solvers.library import train_library, train_share, with_library
from sim.tasks.library import FOLDER as POLICIES
from sim.tasks.task import Solver, Task

TRAINING, GRID = "policies", "grid of rollouts"

GRID_SHARD = 64
"""Rollouts per file of a grid: at most these are lost in an interruption."""


def grid_tensors(folder: Path, solver: Solver, executor: Executor, progress: StageProgress) -> dict[str, Array]:
    """Simulate the grid of a solver that has one, and give its tensors for the checkpoint."""
    grid = grid_behind(solver)
    if grid is None:
        return {}
    assert isinstance(solver, ListedActionSolver)
    shards = _shards(folder, grid, solver)
    if shards:
        progress(measured_cost(solver.task, 0).in_words(sum(map(len, shards.values()))), 1, 1)
        rollouts = simulate_missing(solver.task, shards, executor, lambda i, n: progress(GRID, i, n))
        grid.take(solver.listed, rollouts)
    return {f"{GRID_TENSORS}{name}": tensor for name, tensor in grid.tensors.items()}


def grid_rollouts(tensors: Mapping[str, Array]) -> int:
    """The number of rollouts in the tensors of a checkpoint with a grid; 0 without one."""
    success = tensors.get(f"{GRID_TENSORS}success")
    return 0 if success is None else int(success.size)


def trained(task: Task, folder: Path, seed: int, executor: Executor, progress: StageProgress) -> Task:
    """The task with the library of policies that it trains in `folder`. Raises TaskError if a training fails."""
    return with_library(task, train_library(task, folder / POLICIES, seed, executor, _shown(progress, TRAINING)))


def simulate_grid_share(
    task: Task, folder: Path, seed: int, share: Share, executor: Executor, progress: StageProgress
) -> bool | None:
    """Train one share of a task's policies, and simulate one share of its grid; several processes may do so at a time.

    Returns whether the share is complete: False while the grid waits for the policies of other shares, and None for a
    task without a grid that could be simulated before a session. Raises TaskError if a training fails.
    """
    if task.training is not None:
        if not train_share(task, folder / POLICIES, seed, share, executor, _shown(progress, TRAINING)):
            return False
        task = trained(task, folder, seed, executor, progress)
    solver = task.exact(task) if task.exact else None
    grid = None if solver is None else grid_behind(solver)
    if grid is None:
        return None
    assert isinstance(solver, ListedActionSolver)
    shards = _shards(folder, grid, solver)
    if not shards:
        return True if task.training is not None else None
    simulate_share(task, shards, share, executor, _shown(progress, GRID))
    return True


def _shards(folder: Path, grid: GridSolver, solver: ListedActionSolver) -> dict[Path, Requests]:
    requests = grid.requests(solver.listed)
    return into_shards(requests, GRID_SHARD, lambda number: folder / "grid" / f"shard-{number:05d}.npz")


def _shown(progress: StageProgress, stage: str) -> Callable[[int, int], None]:
    return lambda done, total: progress(stage, done, total)
