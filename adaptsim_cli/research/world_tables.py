"""Tables of true rollouts, in which a benchmark looks up its trials: which are wanted, and how they are made."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.research.sealed import seal_of
from adaptsim_cli.research.working import StageProgress, working_in

if TYPE_CHECKING:
    from sim.lab.physics import Physics
    from sim.research.benchmark.tables import PlannedTable
    from sim.research.benchmark.worlds import BenchmarkWorld
    from sim.rollouts.run import StageProgress
    from sim.rollouts.shares import Share
    from sim.tasks.task import Task


def tables_folder(resolved: Resolved) -> Path:
    """The folder of the tables of the settings' task."""
    return resolved.places.world_tables / resolved.config.task


TABLES_BUSY = "another process is making tables in {}: wait for it"


def make_tables(
    resolved: Resolved, targets: str, rollouts: int, executor: Executor, progress: StageProgress
) -> list[dict[str, Any]]:
    """Simulate the missing parts of the tables of these worlds; one entry per world, for JSON.

    Raises UsageError for a task that needs none, UnknownName, DatasetError, RolloutError, SessionError.
    """
    tables, rows = _planned(resolved, targets, rollouts), list[dict[str, Any]]()
    with working_in(tables_folder(resolved), TABLES_BUSY):
        for i, (target, table) in enumerate(tables):
            built = table.build(executor, partial(_report, progress, i * rollouts, len(tables) * rollouts))
            rows.append(
                {
                    "set": target.set,
                    "world": target.name,
                    "rollouts": len(built.actions),
                    "digest": built.digest,
                    "folder": str(table.folder),
                }
            )
    return rows


def make_tables_share(
    resolved: Resolved, targets: str, rollouts: int, share: Share, executor: Executor, progress: StageProgress
) -> int:
    """Simulate the missing parts of one share of the tables of these worlds, and return the number of its files.

    Raises as `make_tables`.
    """
    tables, files, before = _planned(resolved, targets, rollouts), 0, 0
    with working_in(tables_folder(resolved), TABLES_BUSY, share):
        for i, (_, table) in enumerate(tables):
            show = partial(_report, progress, i * rollouts, len(tables) * rollouts)
            mine, all_of_it = table.build_share(share, before, executor, show)
            files, before = files + mine, before + all_of_it
    return files


def _planned(resolved: Resolved, targets: str, rollouts: int) -> list[tuple[BenchmarkWorld, PlannedTable]]:
    from adaptsim_cli.bench.checkpoints import usual_checkpoint
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.research.benchmark.tables import PlannedTable
    from sim.research.benchmark.worlds import targets_of
    from sim.tasks import get_task

    config = resolved.config
    task = get_task(config.task)
    if task.exact:
        raise UsageError(f"{task.name} needs no tables: its trials cost next to nothing, so a benchmark simulates them")
    if task.training:
        raise UsageError(
            f"{task.name} needs no tables: its actions are trained policies, so a benchmark simulates them"
        )
    checkpoint = load_checkpoint(task, config.checkpoint or usual_checkpoint(task))
    seal = seal_of(resolved, targets)
    chosen = targets_of(task, comma_separated(targets)) if seal is None else seal.worlds(task)
    scenes, folder = scene_keys(task, chosen), tables_folder(resolved)
    make = partial(PlannedTable, checkpoint.solver, checkpoint.sha256)
    return [(t, make(scenes[t.world.physics], t.world, folder / t.set / t.name, rollouts)) for t in chosen]


def _report(progress: StageProgress, before: int, total: int, done: int, _: int) -> None:
    progress("rollouts", before + done, total)


def scene_keys(task: Task, targets: Sequence[BenchmarkWorld]) -> dict[Physics, str]:
    """The key of the scene, for each physics among the targets."""
    from sim.lab.physics import in_physics
    from sim.tasks.fingerprint import scene_key

    return {physics: scene_key(in_physics(task, physics)) for physics in {t.world.physics for t in targets}}


def comma_separated(listed: str) -> tuple[str, ...]:
    """The words of a list as it is typed, without blanks."""
    return tuple(word.strip() for word in listed.split(",") if word.strip())
