"""UDR's policies of several trainings: their mean actions, and the rewards that each emulator predicts for each policy
over Omega.

python benchmarks/udr_trainings.py default second/checkpoint
"""

from __future__ import annotations

import argparse

import numpy as np

from sim.adaptation.checkpoint import load_checkpoint
from sim.research.benchmark.sessions import udr_policies
from sim.rollouts.draws import cover
from sim.tasks import get_task

CONTEXTS, E, DRAWS = 32, 64, 4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+", help="names or folders")
    parser.add_argument("--task", default="scooping")
    arguments = parser.parse_args()
    task = get_task(arguments.task)
    solvers = [load_checkpoint(task, name).solver for name in arguments.checkpoints]
    contexts = cover(task.context, CONTEXTS, np.random.default_rng(0))
    parameters = cover(task.parameters, E, np.random.default_rng(1))
    everywhere = np.stack([contexts] * E)
    for name, solver in zip(arguments.checkpoints, solvers, strict=True):
        actions = np.stack([policy.actions(contexts) for policy in udr_policies(solver, 0)])
        mean = actions.mean(axis=(0, 1))
        print(name, ", ".join(f"{d.name} {v:.4f}" for d, v in zip(task.action.dimensions, mean, strict=True)))
        first = np.stack([actions[0]] * E)
        for judge, other in zip(arguments.checkpoints, solvers, strict=True):
            reward = other.expected_rewards(parameters, everywhere, first, np.random.default_rng(2), DRAWS).mean()
            print(f"  by the emulator of {judge}: {reward:.3f}")


if __name__ == "__main__":
    main()
