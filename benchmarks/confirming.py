"""What it gains to simulate the emulator's best actions before one is executed (`sim.solvers.confirmation`).

    python benchmarks/confirming.py --task scooping

For each of `--policies` parameter vectors that fill the ranges, and each of `--contexts`: the action that the policy
takes by the emulator alone, and the one it takes after its winners were simulated, both by `--rollouts` fresh true ones
in a simulator with exactly these parameters, under the same executed error and nuisance.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.rollouts import run_many, serial_executor
from sim.rollouts.draws import cover, trial_requests
from sim.rollouts.run import Roll
from sim.solvers.confirmation import SCENARIOS, WINNERS, ConfirmingPolicies
from sim.solvers.solver import policy_for
from sim.tasks import get_task

BOOTSTRAP = 4000


def main() -> None:
    arguments = _arguments()
    judge = partial(judged, arguments.task, arguments.policies, arguments.contexts, arguments.rollouts)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.workers, mp_context=context) as pool:
        rewards = np.array(list(pool.map(judge, range(arguments.policies))))  # (E, 2)
    gain = rewards[:, 1] - rewards[:, 0]
    drawn = np.random.default_rng(0).integers(len(gain), size=(BOOTSTRAP, len(gain)))
    low, high = np.quantile(gain[drawn].mean(axis=1), [0.025, 0.975])
    print(
        f"{arguments.task}: by the emulator alone {rewards[:, 0].mean():.3f}, with {WINNERS} winners confirmed by "
        f"{SCENARIOS} rollouts each {rewards[:, 1].mean():.3f}: {gain.mean():+.3f} ({low:+.3f} to {high:+.3f}, 95 %, "
        f"bootstrap over {len(gain)} parameter vectors)"
    )


def judged(name: str, policies: int, contexts: int, rollouts: int, which: int) -> tuple[float, float]:
    """Mean true rewards of one vector's policy, unconfirmed and confirmed."""
    task = get_task(name)
    checkpoint = load_checkpoint(task, "default")
    if checkpoint.emulator is None:
        sys.exit(f"{name} has no emulator, so there is nothing to confirm")
    mean = cover(task.parameters, policies, np.random.default_rng(5))[which]
    with serial_executor() as executor:
        roll: Roll = partial(run_many, task, executor=executor)

        def earned(context: Array, action: Array) -> float:
            where, at, done = (np.tile(row, (rollouts, 1)) for row in (mean, context, action))
            request = trial_requests(task, where, at, done, np.random.default_rng(7))
            return float(roll(request).rewards(task, request.context).mean())

        confirming = ConfirmingPolicies(checkpoint.emulator, roll)
        plain, confirmed = (policy_for(policies, mean[None]) for policies in (checkpoint.solver, confirming))
        drawn = task.context.sample(np.random.default_rng(100 + which), contexts)
        found = [(earned(c, plain(c)), earned(c, confirmed(c))) for c in drawn]
    return float(np.mean([f[0] for f in found])), float(np.mean([f[1] for f in found]))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--policies", type=int, default=12)
    parser.add_argument("--contexts", type=int, default=4)
    parser.add_argument("--rollouts", type=int, default=12)
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args()


if __name__ == "__main__":
    main()
