"""The processor time of a session in the whole lab, and of the same loop whose trials are rollouts.

    python benchmarks/lab_cost.py [--task scooping] [--world wd] [--iterations 3] [--seed 0]

Both loops choose actions, run the trials of each iteration and adapt. In the lab, a trial has arm, camera and tracking.
In the other loop it is a true rollout in the same world, without them. The first iteration also prepares the renderer
and fills caches, so the ratio is that of the later ones. Each line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does

import psutil

from adaptsim_cli.research.lab_place import InLab, rig_in_lab
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.lab.world import load_world
from sim.research.benchmark.entries import make_entry
from sim.research.benchmark.sessions import Conditions, run_iterations
from sim.research.benchmark.trial_sources import SimulatedTrials, TrialSource
from sim.tasks import get_task


def main() -> None:
    """Run both loops, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--world", default="wd")
    parser.add_argument("--iterations", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.iterations < 2:
        parser.error(f"--iterations is {options.iterations}: it must be 2 or more, because the first does not count")
    task = get_task(options.task)
    world, checkpoint = load_world(options.world, task), load_checkpoint(task, "default")
    with rig_in_lab(task, world, options.seed) as (_, rig):
        rollouts = SimulatedTrials(checkpoint.solver, world, rig.executable)
        places: dict[str, TrialSource] = {"rollouts": rollouts, "whole lab": InLab(rig, rollouts, rig.executable)}
        later_s = dict.fromkeys(places, 0.0)
        for name, trials in places.items():
            for number, spent_s in enumerate(iterations_s(checkpoint, trials, options.iterations, options.seed), 1):
                print(json.dumps({"trials": name, "iteration": number, "processor_s": round(spent_s, 2)}), flush=True)
                later_s[name] += spent_s if number > 1 else 0.0
    print(json.dumps({"world": world.name, "ratio": round(later_s["whole lab"] / later_s["rollouts"], 1)}))


def iterations_s(checkpoint: Checkpoint, trials: TrialSource, count: int, seed: int) -> Iterator[float]:
    """Processor time of each iteration of `adaptsim` with trials from that place, its rendering processes included."""
    task = checkpoint.solver.task
    conditions = Conditions(budget=count * 2 * task.adaptation.trials_per_iteration)
    before_s = processor_s()
    for _ in run_iterations(checkpoint.solver, make_entry("adaptsim", task, checkpoint), trials, conditions, seed):
        now_s = processor_s()
        yield now_s - before_s
        before_s = now_s


def processor_s() -> float:
    """Of this process and of its living children."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    times = [process.cpu_times() for process in processes]
    return float(sum(one.user + one.system for one in times))


if __name__ == "__main__":
    main()
