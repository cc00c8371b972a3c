"""How often the interval of a parameter holds the truth, in drawn worlds of the pendulum.

    python benchmarks/coverage.py [--set drawn] [--budget 10] [--seed 0]

Forty sessions of the default method in forty drawn worlds; none was dropped. After each, the central 90 % of the
posterior should hold the true value in 36 of 40. A parameter is identified in a session if its interval is narrower
than half of the interval before any trial. The world's values outside of the grid's margin are counted, too.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.methods import make_method
from sim.adaptation.methods.belief import create
from sim.adaptation.posterior import RESOLVED, Posterior, posterior
from sim.research.benchmark.sessions import Conditions, run_iterations
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.research.benchmark.worlds import targets_of
from sim.tasks import get_task

LEVELS = (0.05, 0.95)
NARROWED = 0.5
"""A parameter is identified if its interval is narrower than this share of the one without trials."""


@dataclass(frozen=True)
class Coverage:
    """One parameter over all worlds."""

    parameter: str
    identified: int  # worlds in which the trials identify it
    held: int  # of these, worlds in which the interval holds the truth
    held_of_all: int  # of all worlds
    width: float  # median width of the interval, as a share of that without trials


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", default="drawn", help="set of worlds, or names")
    parser.add_argument("--budget", type=int, default=10, help="trials of a session")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    found = coverage("pendulum", asked.set.split(","), asked.budget, asked.seed)
    print(f"{asked.set}, {asked.budget} trials, seed {asked.seed}, at least {RESOLVED:g} effective samples")
    for one in found:
        print(
            f"{one.parameter:12} identified in {one.identified:2}, its 90 % hold the truth in {one.held:2} of these, "
            f"in {one.held_of_all} of all; width {one.width:.2f} of the prior's"
        )


def coverage(task_name: str, worlds: Sequence[str], budget: int, seed: int) -> tuple[Coverage, ...]:
    """The coverage of each parameter's interval, after a session of the default method in each world."""
    task = get_task(task_name)
    checkpoint = load_checkpoint(task, "default")
    belief, before = create(task, checkpoint), posterior(create(task, checkpoint), ())
    prior = _width(before)
    holds, shares = [], []
    for target in targets_of(task, worlds):
        method, place = make_method("adaptsim", task, checkpoint), SimulatedTrials(checkpoint.solver, target.world)
        *_, history = run_iterations(checkpoint.solver, method, place, Conditions(budget), seed)
        known = posterior(belief, history)
        low, high = known.quantiles(LEVELS)
        truth = target.world.parameters
        holds.append((low <= truth) & (truth <= high))
        shares.append(_width(known) / prior)
    held, share = np.array(holds), np.array(shares)
    found = share < NARROWED
    return tuple(
        Coverage(
            name,
            int(found[:, i].sum()),
            int((held & found)[:, i].sum()),
            int(held[:, i].sum()),
            float(np.median(share[:, i])),
        )
        for i, name in enumerate(task.parameters.names)
    )


def _width(known: Posterior) -> Array:
    low, high = known.space.normalise(known.quantiles(LEVELS))
    return np.asarray(high - low)


if __name__ == "__main__":
    main()
