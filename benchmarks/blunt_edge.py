"""Is another scoop the best one because the turner is bevelled in training? Rollouts with a blunt edge against the
emulator.

The rollouts are a dataset of the plain scooping task in the scene of a blunt edge: spread evenly over the margin, all
actions and the nuisance. For the same trials it prints the expectation of the shipped emulator, which knows only the
bevelled edge. With --trained, it adds the emulator of a checkpoint that `adaptsim object` trained for a blunt edge.
Stop it at any time: the same command continues.

    python benchmarks/blunt_edge.py --rollouts 256 --seed 21 --out build/blunt-edge [--trained FOLDER]
"""

from __future__ import annotations

import argparse
import logging
from itertools import pairwise
from pathlib import Path

from scipy import stats

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.research.pretraining.dataset_share import stage_seeds
from sim.rollouts.dataset import build_dataset
from sim.rollouts.executors import serial_executor
from sim.solvers.emulator.training import held_out_errors
from sim.tasks import get_task
from sim.tasks.own_object import OwnObject, with_ranges

EDGE = (0.0011, 3000.0)
"""Height of the lip, m, and stiffness of each corner, N/m."""

BOUNDS_RAD_S = (-0.24, -0.12, -0.04, 0.04, 0.12, 0.24)


def row(blunt: Array, predicted: Array) -> str:
    """Means with 1.96 standard errors, paired."""
    n, off = len(blunt), blunt - predicted
    of_blunt, of_difference = (1.96 * values.std() / n**0.5 for values in (blunt, off))
    return (
        f"{n:4} rollouts: blunt {blunt.mean():.2f} (± {of_blunt:.2f}), emulator {predicted.mean():.2f}, "
        f"difference {off.mean():+.2f} (± {of_difference:.2f})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rollouts", type=int, default=256)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--out", type=Path, default=Path("build/blunt-edge"))
    parser.add_argument("--trained", type=Path, help="a checkpoint for the same edge")
    wanted = parser.parse_args()
    logging.getLogger("drake").setLevel(logging.ERROR)
    plain = get_task("scooping")
    task = with_ranges(plain, OwnObject("scooping", "food on a blunt edge", {}, effects={"edge": EDGE}))
    with serial_executor() as here:
        dataset = build_dataset(task, wanted.out, wanted.rollouts, stage_seeds(wanted.seed)[0], here)
    requests = dataset.requests
    blunt = dataset.rollouts.rewards(task, requests.context)
    checkpoints = {"shipped": load_checkpoint(plain)}
    if wanted.trained is not None:
        checkpoints["trained"] = load_checkpoint(task, str(wanted.trained))
    rate = requests.action[:, 0]
    for name, checkpoint in checkpoints.items():
        assert checkpoint.emulator is not None
        errors = held_out_errors(checkpoint.emulator, requests, dataset.rollouts)
        print(f"{name}: {errors['accuracy'].mean():.2f} of the outcomes right")
        predicted = checkpoint.solver.trial_rewards(
            requests.parameters, requests.context, requests.action, requests.nuisance
        )
        for low, high in pairwise(BOUNDS_RAD_S):
            chosen = (rate >= low) & (rate <= high)
            print(f"  pitch rate {low:+.2f} to {high:+.2f} rad/s, {row(blunt[chosen], predicted[chosen])}")
        slope = stats.linregress(rate, blunt - predicted)
        change = f"{slope.slope:.2f} (± {1.96 * slope.stderr:.2f})"
        print(f"  the difference grows by {change} per rad/s, p = {slope.pvalue:.1e}")


if __name__ == "__main__":
    main()
