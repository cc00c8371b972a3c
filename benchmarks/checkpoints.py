"""Checkpoints of one task side by side: the errors of their emulators, and what their policies earn by true rollouts.

    python benchmarks/checkpoints.py --task pushing default build/first/checkpoint build/second/checkpoint

2,048 accurate rollouts evenly over the margin judge all emulators. The policies are judged in environments that fill
Omega, each in its own, at four contexts by 16 rollouts in all; environments, contexts and disturbances are the same for
all checkpoints. Differences are to the first one, with the interval over the environments; the last line is the mean
over all the others. Rollouts are kept in the folder, so a stopped run goes on.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.rollouts import process_pool
from sim.rollouts.cache import CachedRollouts
from sim.rollouts.dataset import SHARD, draw_requests
from sim.rollouts.draws import cover, trial_requests
from sim.rollouts.run import Requests, Rollouts, concatenate, run_parts
from sim.rollouts.shards import read_rollouts, write_rollouts
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import held_out_errors
from sim.solvers.solver import Solver
from sim.tasks import get_task
from sim.tasks.task import Task

HELD_OUT = 3
"""Seed of the held-out draw."""
HELD = 2048
CONTEXTS, REPEATS = 4, 4
"""Per environment: contexts, and true rollouts at each."""

Pool = tuple[Requests, Rollouts]


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


def pool(task: Task, size: int, seed: int, folder: Path, executor: Executor) -> Pool:
    """`size` rollouts evenly over the margin, kept in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    requests = draw_requests(task, size, np.random.default_rng(seed))
    parts = {folder / f"shard-{i // SHARD:05d}.npz": requests[i : i + SHARD] for i in range(0, size, SHARD)}
    there = {path: read_rollouts(path, part) for path, part in parts.items()}
    missing = [path for path, rollouts in there.items() if rollouts is None]
    if missing:
        made = run_parts(task, [parts[path] for path in missing], executor)
        for path, rollouts in zip(missing, made, strict=True):
            write_rollouts(path, parts[path], rollouts)
            there[path] = rollouts
            print(f"{path.name} of {len(parts)}", flush=True)
    return requests, concatenate(rollouts for rollouts in there.values() if rollouts is not None)


def figures(emulator: Emulator, held: Pool) -> Array:
    """(5,) held-out errors; lengths in mm."""
    errors = held_out_errors(emulator, *held)
    position, end = errors["position_error_median"], errors["end_state_error_median"]
    lengths_mm = [1e3 * value for value in (np.median(position), np.quantile(position, 0.9), np.median(end))]
    return np.array([errors["accuracy"].mean(), errors["brier"].mean(), *lengths_mm])


def earned_by(solver: Solver, environments: int, roll: CachedRollouts) -> Array:
    """(environments,) mean true reward of the solver's policies, each in its own environment."""
    task = solver.task
    E = cover(task.parameters, environments, np.random.default_rng(4))
    contexts = cover(task.context, CONTEXTS, np.random.default_rng(5))
    policies = solver.policies(E[:, None], np.random.default_rng(6))
    actions = np.stack([policy.actions(contexts) for policy in policies])  # (E, CONTEXTS, a)
    repeated = np.repeat(actions.reshape(-1, actions.shape[-1]), REPEATS, axis=0)
    where = np.repeat(np.tile(contexts, (len(E), 1)), REPEATS, axis=0)
    targets = np.repeat(E, CONTEXTS * REPEATS, axis=0)
    requests = trial_requests(task, targets, where, repeated, np.random.default_rng(8))
    return np.asarray(roll(requests).rewards(task, where).reshape(len(E), -1).mean(axis=1))


def interval(differences: Array) -> tuple[float, float]:
    """95 % of bootstrapped means of (n,) differences."""
    rng = np.random.default_rng(9)
    means = differences[rng.integers(len(differences), size=(4000, len(differences)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


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
