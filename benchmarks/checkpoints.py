"""Checkpoints of one task side by side: the errors of their emulators, and what their policies earn by true rollouts.

    python benchmarks/checkpoints.py --task pushing default build/first/checkpoint build/second/checkpoint

2,048 accurate rollouts evenly over the margin judge all emulators. The policies are judged in environments that fill
Omega, each in its own, at four contexts by 16 rollouts in all; environments, contexts and disturbances are the same for
all checkpoints. Differences are to the first one, with the interval over the environments; the last line is the mean
over all the others. Rollouts are kept in the folder, so a stopped run goes on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from coarse import HELD, HELD_OUT, earned_by, figures, interval, pool

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.rollouts import process_pool
from sim.rollouts.cache import CachedRollouts
from sim.tasks import get_task


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    loaded = {name: load_checkpoint(task, name) for name in arguments.checkpoints}
    with process_pool(arguments.workers) as executor:
        held = pool(task, HELD, HELD_OUT, arguments.folder / f"{task.name}-held", executor)
        print("checkpoint | outcome right | Brier | XY median / p90, mm | end state of a success, mm")
        for name, checkpoint in loaded.items():
            if checkpoint.emulator is not None:
                right, brier, median_mm, p90_mm, end_mm = figures(checkpoint.emulator, held)
                print(f"{name} | {right:.3f} | {brier:.4f} | {median_mm:.1f} / {p90_mm:.0f} | {end_mm:.1f}", flush=True)
        roll = CachedRollouts(task, arguments.folder / f"{task.name}-judged", executor)
        print(f"checkpoint | reward in {arguments.policies} E | minus {arguments.checkpoints[0]} (95 %, over E)")
        earned = {name: earned_by(checkpoint.solver, arguments.policies, roll) for name, checkpoint in loaded.items()}
    first, *others = earned.values()
    for name, rewards in earned.items():
        print(f"{name} | {rewards.mean():.4f} | {_told(rewards - first)}")
    if len(others) > 1:
        print(f"mean of the others | {np.mean(others):.4f} | {_told(np.mean(others, axis=0) - first)}")


def _told(differences: Array) -> str:
    low, high = interval(differences)
    return f"{differences.mean():+.4f} ({low:+.4f} to {high:+.4f})"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+", help="names of shipped ones, or folders; the first is compared with")
    parser.add_argument("--task", default="pushing")
    parser.add_argument("--policies", type=int, default=32, help="environments in which policies are judged")
    parser.add_argument("--folder", type=Path, default=Path("build/checkpoints"))
    parser.add_argument("--workers", type=int)
    return parser.parse_args()


if __name__ == "__main__":
    main()
