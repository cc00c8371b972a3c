"""Rewards of the default method in pendulums inside Omega, outside of it in the margin, and beyond the margin.

    python benchmarks/pendulum_truths.py --seed 6841 --worlds 8 --budget 4

Beyond the margin, only pendulums with an optimal gain in the ranges of the action count. Sessions are deterministic, so
each world has one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.methods import make_method
from sim.lab.drawn import drawn_world
from sim.research.benchmark.sessions import Conditions, run_session
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.tasks import get_task
from sim.tasks.pendulum.rollout import optimal
from sim.tasks.pendulum.solver import rewards

WIDE = np.array([[0.25, 0.2, 0.5, 0.5], [4.0, 5.0, 20.0, 20.0]])
"""Ends of the box in which pendulums beyond the margin are drawn."""


def drawn(seed: int, worlds: int) -> dict[str, list[Array]]:
    """Parameters (4,) of `worlds` pendulums of each kind, by its name."""
    task, rng = get_task("pendulum"), np.random.default_rng(seed)

    def sample(draw: Callable[[], Array], counts: Callable[[Array], bool]) -> list[Array]:
        chosen = list[Array]()
        while len(chosen) < worlds:
            parameters = draw()
            if counts(parameters):
                chosen.append(parameters)
        return chosen

    def is_beyond(parameters: Array) -> bool:
        return not task.margin.contains(parameters) and task.action.contains(optimal(parameters)[0].reshape(-1))

    return {
        "inside": list(task.parameters.sample(rng, worlds)),
        "outside": sample(lambda: task.margin.sample(rng, 1)[0], lambda p: not task.parameters.contains(p)),
        "beyond": sample(lambda: rng.uniform(*WIDE), is_beyond),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=6841)
    parser.add_argument("--worlds", type=int, default=8, help="of each kind")
    parser.add_argument("--budget", type=int, default=4, help="trials of a session; an iteration has two")
    asked = parser.parse_args()
    task = get_task("pendulum")
    checkpoint, base = load_checkpoint(task), drawn_world(task, 41, 0)
    for kind, worlds in drawn(asked.seed, asked.worlds).items():
        earned, begun = [], time.process_time()
        for parameters in worlds:
            place = SimulatedTrials(checkpoint.solver, replace(base, parameters=parameters))
            method = make_method("adaptsim", task, checkpoint)
            policies = run_session(checkpoint.solver, method, place, Conditions(asked.budget), 0)
            earned.append([float(rewards(parameters, p.actions(np.zeros((1, 0)))[0])) for p in policies])
        table = np.array(earned)
        cpu_s = (time.process_time() - begun) / len(worlds)
        print(
            f"{kind:8}{len(worlds)} worlds; after each iteration mean {table.mean(axis=0).round(4)}, least "
            f"{table.min(axis=0).round(4)}; {cpu_s:.1f} s of CPU a session",
            flush=True,
        )


if __name__ == "__main__":
    main()
