"""Trains emulator and prospects again with other seeds, from one dataset: all that `adaptsim` learns from.

    python benchmarks/training_seeds.py --task scooping --dataset build/scooping/dataset --seeds 1 2 --out build/seeds
    adaptsim benchmark --task scooping --targets drawn --methods adaptsim --seeds 3 --fresh 8 \
        --checkpoints default,build/seeds/1,build/seeds/2

The dataset is that folder of `adaptsim pretrain`. A checkpoint per seed is written to the folder `--out`; one that is
there is kept. The paper's policies are not trained.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from sim.adaptation.checkpoint import save_checkpoint
from sim.adaptation.prospects import look_ahead
from sim.research.pretraining.pipeline import PretrainBudget, stage_seeds
from sim.rollouts import load_dataset
from sim.solvers.emulator.solver import EmulatorSolver
from sim.solvers.emulator.training import train_emulator
from sim.tasks import get_task


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--dataset", type=Path, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    task = get_task(asked.task)
    budget = PretrainBudget.full(task)
    dataset = load_dataset(asked.dataset, task)
    for seed in asked.seeds:
        if (asked.out / str(seed)).exists():
            continue
        _, of_emulator, of_prospects, _ = stage_seeds(seed)
        emulator, held_out = train_emulator(task, dataset, of_emulator, budget.emulator, _silent)
        ahead = look_ahead(EmulatorSolver(emulator), of_prospects, budget.prospects, _silent)
        facts = {"seed": seed, "method": "adaptsim-belief", "data": dataset.identity, "emulator": asdict(held_out)}
        save_checkpoint(task, asked.out / str(seed), emulator, {}, {**facts, "simulations": len(dataset)}, ahead)
        print(f"seed {seed}: {asked.out / str(seed)}", flush=True)


def _silent(done: int, total: int) -> None:
    """Show no progress."""


if __name__ == "__main__":
    main()
