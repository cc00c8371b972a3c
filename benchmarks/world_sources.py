"""Trials in the world of a benchmark: true rollouts, or looked up in the table that `adaptsim world-tables` made."""

from __future__ import annotations

from adaptsim_cli import config
from adaptsim_cli.research.world_tables import tables_folder
from sim.lab.physics import in_physics
from sim.research.benchmark.tables import load_table
from sim.research.benchmark.trial_sources import SimulatedTrials, TableTrials, TrialSource
from sim.research.benchmark.worlds import BenchmarkWorld
from sim.tasks.fingerprint import scene_key
from sim.tasks.task import Solver


def source_in(target: BenchmarkWorld, solver: Solver, *, tables: bool) -> TrialSource:
    """The trials of a world. Raises DatasetError where its table is missing."""
    if not tables:
        return SimulatedTrials(solver, target.world)
    task = solver.task
    folder = tables_folder(config.load({"task": task.name})) / target.set / target.name
    scene = scene_key(in_physics(task, target.world.physics))
    return TableTrials(task, load_table(task, target.world, scene, folder))
