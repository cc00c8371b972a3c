"""Ways to adapt a task of one file, with the same trials: scripts that fit trajectories
(`fitting_scripts.py`), ours with and without Phase 1, and others.

    adaptsim pretrain --task glide.py --budget small         # in a folder with the page's glide.py and scene.xml
    python benchmarks/own_simulator.py glide.py [--worlds wd tilted] [--seeds 3] [--budget 8] [--methods ...]
        [--out rows.jsonl] [--limit 900]

Prints, for each way and world, the mean reward of its final policy by true rollouts in the world, with the lowest and
the highest of the seeds, and the rollouts that it simulated. Sessions that are in `--out` are not run again, and none
begins after `--limit` seconds. The checkpoint is the newest one of the task.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fitting_scripts import INFERENCES, FittingScript, lines_of
from kept import Kept

from adaptsim_cli.bench.checkpoints import usual_checkpoint
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.method import Method, Simulating
from sim.adaptation.methods import make_method
from sim.lab.world import load_world
from sim.research.benchmark.jobs import simulations
from sim.research.benchmark.sessions import Conditions, estimated_reward, mean_of, run_session, udr_policies
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.tasks import task_of_file
from sim.tasks.task import SolvedPolicy
from sim.types import Estimate

METHODS = ("udr", *INFERENCES, "direct", "random", "bo", "sysid-bayes", "adaptsim")

JUDGED = 32


def session(name: str, checkpoint: Checkpoint, world: str, seed: int, conditions: Conditions) -> dict[str, Any]:
    """One session: rewards of the policies after the first and the last iteration, and rollouts simulated for it."""
    solver, task, began = checkpoint.solver, checkpoint.solver.task, time.perf_counter()
    source = SimulatedTrials(solver, load_world(world, task))

    def score(policy: SolvedPolicy) -> Estimate:
        return estimated_reward(task, policy.actions, source, conditions, seed)

    rollouts = simulations(name, checkpoint) if name not in INFERENCES else 0
    if name == "udr":
        first = last = mean_of([score(policy) for policy in udr_policies(solver, seed)])
    else:
        infer = INFERENCES.get(name)
        method: Method = FittingScript(task, infer) if infer else make_method(name, task, checkpoint)
        policies = run_session(solver, method, source, conditions, seed)
        first, last = score(policies[0]), score(policies[-1])
        if isinstance(method, FittingScript):
            rollouts = method.roll.simulated
        elif isinstance(method, Simulating):
            rollouts = method.rollouts.simulated
    return {
        "first": first.mean,
        "final": last.mean,
        "ci95": [last.low, last.high],
        "rollouts": rollouts,
        "wall_s": round(time.perf_counter() - began, 1),
    }


def line(way: str, world: str, rows: Sequence[dict[str, Any]]) -> str:
    """A row of the table."""
    first, final, rollouts = (np.array([row[name] for row in rows]) for name in ("first", "final", "rollouts"))
    spread = f"{final.min():.3f} to {final.max():.3f}"
    mean = f"{first.mean():8.3f} {final.mean():8.3f}"
    return f"{way:13} {world:10} {len(rows):5} {mean} {spread:>16} {rollouts.mean():10.0f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--worlds", nargs="+", default=["wd", "tilted"])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=8)
    parser.add_argument("--judged", type=int, default=JUDGED)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds after which no session begins")
    asked = parser.parse_args()
    began, task = time.perf_counter(), task_of_file(asked.file)
    checkpoint = load_checkpoint(task, usual_checkpoint(task))
    conditions, kept = Conditions(asked.budget, judged=asked.judged), Kept(asked.out)
    print("lines of the scripts:", ", ".join(f"{way} {lines_of(way)}" for way in INFERENCES))
    print(f"'first': after one iteration, 'final': after {asked.budget} trials; then lowest and highest of the seeds")
    print(f"{'way':13} {'world':10} {'seeds':>5} {'first':>8} {'final':>8} {'seeds lie in':>16} {'rollouts':>10}")
    for name in asked.methods:
        for world in asked.worlds:
            rows = []
            for seed in range(asked.seeds):
                case = f"{task.name} {world} {name} {asked.budget} {asked.judged} {checkpoint.card.sha256[:12]}"
                if kept.knows(case, seed) or time.perf_counter() - began < asked.limit:
                    rows.append(kept.row(case, seed, partial(session, name, checkpoint, world, seed, conditions)))
            if rows:
                print(line(name, world, rows), flush=True)


if __name__ == "__main__":
    main()
