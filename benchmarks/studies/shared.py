"""What studies have in common: checkpoints of changed tasks, sessions, intervals, figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from kept import Kept

from adaptsim_cli import config
from adaptsim_cli.research.benchmarking import tables_folder
from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.adaptation.methods import make_method
from sim.research.benchmark.places import Place, Simulated, Tabled
from sim.research.benchmark.sessions import Conditions, judge, run_session, udr_policies
from sim.research.benchmark.tables import load_table
from sim.research.benchmark.targets import targets_of
from sim.research.pretraining.pipeline import PretrainBudget, Wanted, pretrain
from sim.rollouts.executors import serial_executor
from sim.tasks import get_task
from sim.tasks.scene_key import scene_key
from sim.tasks.task import Task

COLOURS = ("#1f5fa8", "#d1661f", "#2a8f5a", "#8a4fb0", "#777777")


@dataclass(frozen=True)
class Asked:
    """What every study is given."""

    name: str
    seeds: int  # sessions of each case
    trainings: int  # of everything that is trained
    folder: Path  # checkpoints and finished rows
    figure: Path | None

    @property
    def rows(self) -> Kept:
        """Those that are finished; the same command goes on with the others."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return Kept(self.folder / "rows.jsonl")


def trained(task: Task, folder: Path, seed: int) -> Checkpoint:
    """Phase 1 of `task`, which may have other ranges or settings than ours, at full strength without evaluation."""

    def say(stage: str, done: int, total: int) -> None:
        if done == total:
            print(f"  {folder.name}: {stage}", flush=True)

    with serial_executor() as crew:
        path = pretrain(task, folder, PretrainBudget.full(task), seed, crew, say, wanted=Wanted(evaluation=False))
    return load_checkpoint(task, str(path))


def table_of(task_name: str, target: str) -> tuple[Checkpoint, Place]:
    """The shipped checkpoint, and a world that has a table. Raises DatasetError where it has none."""
    task = get_task(task_name)
    (found,) = targets_of(task, [target])
    folder = tables_folder(config.load({"task": task_name})) / found.set / found.name
    return load_checkpoint(task), Tabled(task, load_table(task, found.world, scene_key(task), folder))


def simulated(checkpoint: Checkpoint, target: str) -> Place:
    """A world that is simulated: each trial is a rollout."""
    (found,) = targets_of(checkpoint.solver.task, [target])
    return Simulated(checkpoint.solver, found.world)


def session(checkpoint: Checkpoint, method: str, place: Place, conditions: Conditions, seed: int) -> dict[str, Any]:
    """What the policy after each iteration earns, by rollouts that no session has seen; `udr` is a mean without any."""
    task, solver = checkpoint.solver.task, checkpoint.solver
    if method == "udr":
        several = [judge(task, policy.actions, place, conditions, seed).reward for policy in udr_policies(solver, seed)]
        return {"reward": [float(np.mean(several))]}
    policies = run_session(solver, make_method(method, task, checkpoint), place, conditions, seed)
    return {"reward": [judge(task, policy.actions, place, conditions, seed).reward for policy in policies]}


@dataclass(frozen=True, eq=False)
class Watched:
    """A `Method` that tells its history to `note` whenever it is asked for the next particles."""

    method: Any
    note: Callable[[Sequence[Iteration]], None]

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """See `sim.adaptation.method.Method`."""
        found: tuple[Particle, ...] = self.method.start(n, rng)
        return found

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """See `sim.adaptation.method.Method`."""
        self.note(tuple(history))
        found: tuple[Particle, ...] = self.method.next(history, rng)
        return found

    def __getattr__(self, name: str) -> Any:
        return getattr(self.method, name)


def interval(values: Sequence[float] | Array) -> str:
    """Mean and 95 % bootstrap interval over `values`."""
    mean, low, high = bounds(np.asarray(values))
    return f"{mean:.3f} ({low:.2f} to {high:.2f})"


def bounds(values: Array) -> tuple[float, float, float]:
    """Mean, and the ends of its 95 % bootstrap interval."""
    draws = np.random.default_rng(0).choice(values, (4000, len(values))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    return float(values.mean()), float(low), float(high)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def plot() -> Any:
    """pyplot, without a window."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415 - after the backend is chosen

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "study"})
    return plt


def save(figure: Any, asked: Asked) -> None:
    """Where it was asked for."""
    if asked.figure is not None:
        asked.figure.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(asked.figure, dpi=110)
        print(f"Figure: {asked.figure}")
