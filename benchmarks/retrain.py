"""Trains the networks of a checkpoint again, with another seed, on the rollouts of an earlier pretraining.

The results with such a checkpoint show how much depends on the chance in a training. DATASET is the folder `dataset`
that `adaptsim pretrain` or, for an object, `adaptsim object` has made.

    python benchmarks/retrain.py DATASET --task pushing --seed 2 --out build/pushing-2
    python benchmarks/retrain.py DATASET --task scooping --object blunt-edge --seed 1 --out build/blunt-edge-1

`ADAPTSIM_CHECKPOINT=build/pushing-2 adaptsim benchmark --task pushing ...` then uses the checkpoint.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.research.pretraining.budget import PretrainBudget
from sim.research.pretraining.dataset_share import stage_seeds
from sim.research.pretraining.for_object import LEARNING_RATE
from sim.rollouts.dataset import load_dataset
from sim.solvers.emulator.network import rescaled_to
from sim.solvers.emulator.training import EmulatorSettings, train_emulator
from sim.tasks import get_task
from sim.tasks.own_object import task_of_object


def retrained(task_name: str, own_object: str, dataset: Path, seed: int, out: Path) -> Path:
    """Train on `dataset` and write the checkpoint into `out`. An object's networks begin with the shipped ones, as in
    `adaptsim object`. Raises DatasetError, CheckpointError.
    """
    task, seeds = task_of_object(task_name, own_object), stage_seeds(seed)
    rollouts, budget = load_dataset(dataset, task), PretrainBudget.full(task)
    start, settings, table = None, budget.emulator, budget.prospects
    if own_object:
        shipped = load_checkpoint(get_task(task_name)).emulator
        assert shipped is not None, "a task with an exact solver has no networks"
        start, settings = rescaled_to(shipped, task), replace(EmulatorSettings(), learning_rate=LEARNING_RATE)
        table = RewardTableSettings()
    emulator, _ = train_emulator(task, rollouts, seeds[1], settings, partial(_show, "networks"), start)
    rewards = tabulate_rewards(emulator, seeds[2], table, partial(_show, "rewards"))
    return save_checkpoint(task, out, emulator, {}, {"seed": seed, "data": rollouts.identity}, rewards)


def _show(stage: str, done: int, total: int) -> None:
    print(f"\r{stage}: {done} of {total}", end="\n" if done == total else "", file=sys.stderr)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--task", required=True)
    parser.add_argument("--object", default="", help="file or name of an object")
    parser.add_argument("--seed", type=int, required=True, help="of the networks")
    parser.add_argument("--out", type=Path, required=True, help="folder of the checkpoint")
    asked = parser.parse_args()
    print(retrained(asked.task, asked.object, asked.dataset, asked.seed, asked.out))


if __name__ == "__main__":
    main()
