"""Phase 1: dataset, emulator, adaptation policy, evaluation, checkpoint. Each stage resumes after a kill.

A task with an exact solver needs neither dataset nor emulator, and its rollouts are too cheap to be kept.

The folder holds `plan.toml` (what is being made), `dataset/`, `emulator.safetensors`, `rollouts/` (those of the
episodes and of the evaluation, never simulated twice), `policy.safetensors`, the report of each stage, and
`checkpoint/`. What exists is not made again.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim.adaptation.episodes import Roll
from sim.adaptation.evaluation import EvaluationSettings, evaluate
from sim.adaptation.meta_training import MetaCurve, MetaSettings, train_adaptation
from sim.adaptation.q_network import QNetwork, restore_network
from sim.adaptation.step import state_size
from sim.checkpoint import CARD, load_tensors, save_checkpoint, save_tensors
from sim.emulator import Emulator
from sim.emulator_training import EmulatorSettings, train_emulator
from sim.errors import DatasetError
from sim.files import read_toml, write_toml
from sim.rollouts.cache import CachedRollouts
from sim.rollouts.dataset import build_dataset
from sim.rollouts.run import run_many
from sim.solver import Solver
from sim.task_policy import EmulatorSolver
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

StageProgress = Callable[[str, int, int], None]
"""(stage, done, total)"""

STAGES = ("dataset", "emulator", "adaptation policy", "evaluation", "checkpoint")
EXACT = "dataset and emulator: not needed, this task is solved exactly"
"""Stands in for the first two stages."""


@dataclass(frozen=True)
class PretrainBudget:
    """How much of everything. The defaults are the full strength; `small` is for a first look."""

    rollouts: int = 100_000  # of the dataset
    emulator: EmulatorSettings = field(default_factory=EmulatorSettings)
    meta: MetaSettings = field(default_factory=MetaSettings)
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)

    @classmethod
    def small(cls) -> PretrainBudget:
        """For a first look: about 10,700 rollouts, twenty minutes on two cores where one takes 0.2 s."""
        return cls(
            rollouts=6000,
            meta=MetaSettings(steps=1536, updates=4),
            evaluation=EvaluationSettings(targets=12),
        )

    def simulations(self, task: Task) -> int:
        """Rollouts of dataset, training and evaluation together."""
        trials = task.adaptation.trials_per_iteration
        rounds = -(-self.meta.steps // self.meta.parallel)
        visits = rounds + -(-rounds // task.adaptation.horizon)
        session = self.evaluation.particles * self.evaluation.iterations * trials
        judged = self.evaluation.targets * (2 * session + 4 * self.evaluation.rollouts)
        dataset = 0 if task.exact else self.rollouts
        return dataset + visits * self.meta.parallel * trials + judged


@dataclass(frozen=True, eq=False)
class _Means:
    """What the adaptation policy is trained and judged with."""

    solver: Solver
    emulator: Emulator | None  # to be stored in the checkpoint
    roll: Roll
    facts: dict[str, Any]  # for the card


def pretrain(
    task: Task, folder: Path, budget: PretrainBudget, seed: int, executor: Executor, progress: StageProgress
) -> Path:
    """Make the checkpoint of `task` in `folder` and return its path, for `load_checkpoint`.

    Raises DatasetError when the folder holds another plan. Stop it at any time; the same call goes on.
    """
    _agree_on_plan(task, folder, budget, seed)
    draws = [int(s.generate_state(1)[0]) for s in np.random.SeedSequence(seed).spawn(4)]
    if task.exact:
        progress(EXACT, 1, 1)
        means = _exact(task.exact(task), budget, executor)
    else:
        means = _learnt(task, folder, budget, (draws[0], draws[1]), executor, progress)
    network = _policy(folder, means, budget, draws[2], progress)
    results = _evaluation(folder, means, network, budget, draws[3], progress)
    path = folder / "checkpoint"
    if not (path / CARD).exists():
        facts = {
            "seed": seed,
            "simulations": budget.simulations(task),
            "policy": read_toml(folder / "policy.toml"),
            "evaluation": results,
        }
        save_checkpoint(task, path, means.emulator, network, {**means.facts, **facts})
    progress(STAGES[4], 1, 1)
    return path


def _exact(solver: Solver, budget: PretrainBudget, executor: Executor) -> _Means:
    spent = {"budget": {"meta": asdict(budget.meta), "evaluation": asdict(budget.evaluation)}}
    return _Means(solver, None, partial(run_many, solver.task, executor=executor), spent)


def _learnt(
    task: Task,
    folder: Path,
    budget: PretrainBudget,
    seeds: tuple[int, int],
    executor: Executor,
    progress: StageProgress,
) -> _Means:
    dataset = build_dataset(
        task, folder / "dataset", budget.rollouts, seeds[0], executor, lambda i, n: progress(STAGES[0], i, n)
    )
    path, report = folder / "emulator.safetensors", folder / "emulator.toml"
    if not (path.exists() and report.exists()):
        emulator, held_out = train_emulator(
            task, dataset, seeds[1], budget.emulator, lambda i, n: progress(STAGES[1], i, n)
        )
        save_tensors(path, emulator.tensors)
        write_toml(report, asdict(held_out))
    progress(STAGES[1], 1, 1)
    emulator = Emulator(task, load_tensors(path))
    facts = {"data": dataset.identity, "budget": asdict(budget), "emulator": read_toml(report)}
    return _Means(EmulatorSolver(emulator), emulator, CachedRollouts(task, folder / "rollouts", executor), facts)


def _agree_on_plan(task: Task, folder: Path, budget: PretrainBudget, seed: int) -> None:
    plan = {"task": task.name, "fingerprint": fingerprint(task), "seed": seed, "budget": asdict(budget)}
    path = folder / "plan.toml"
    if not path.exists():
        write_toml(path, plan)
        return
    try:
        stored = read_toml(path)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path} is not valid TOML ({error}): remove the folder and begin again") from error
    different = [key for key, value in plan.items() if stored.get(key) != value]
    if different:
        raise DatasetError(
            f"{folder} was begun with another {', '.join(different)}: use a new folder, or the settings in {path}"
        )


def _policy(folder: Path, means: _Means, budget: PretrainBudget, seed: int, progress: StageProgress) -> QNetwork:
    path, report = folder / "policy.safetensors", folder / "policy.toml"
    if not (path.exists() and report.exists()):
        network, curve = train_adaptation(
            means.solver, means.roll, budget.meta, seed, lambda i, n: progress(STAGES[2], i, n)
        )
        save_tensors(path, network.state_dict())
        write_toml(report, _summary(curve))
    progress(STAGES[2], 1, 1)
    task = means.solver.task
    return restore_network(state_size(task), len(task.parameters), load_tensors(path))


def _evaluation(
    folder: Path, means: _Means, network: QNetwork, budget: PretrainBudget, seed: int, progress: StageProgress
) -> dict[str, Any]:
    path = folder / "evaluation.toml"
    if not path.exists():
        results = evaluate(
            means.solver, network, means.roll, budget.evaluation, seed, lambda i, n: progress(STAGES[3], i, n)
        )
        write_toml(path, asdict(results))
    progress(STAGES[3], 1, 1)
    return read_toml(path)


def _summary(curve: MetaCurve) -> dict[str, Any]:
    quarter = max(1, len(curve.reward) // 4)
    return {
        "first_quarter_reward": float(curve.reward[:quarter].mean()),
        "last_quarter_reward": float(curve.reward[-quarter:].mean()),
        "reward": curve.reward.tolist(),
        "epsilon": curve.epsilon.tolist(),
        "loss": curve.loss.tolist(),
    }
