"""Do the intervals of the shown posterior contain the pendulum's true parameters? Simulation-based calibration.

    python benchmarks/pendulum_intervals.py --seed 5209 --truths 200
    python benchmarks/pendulum_intervals.py --seed 5209 --truths 200 --noise 0.005

Truths are those of `pendulum_truths`: inside Omega, outside of it in the margin, and beyond the margin. Each has two
trials, with the first two actions of a session. Without noise nothing is random, so the best fit is the truth, every
interval should contain it, and only its width matters. `--noise` adds independent normal noise to each observed value,
in fractions of its range: then 90 % of the intervals should contain the truth, and its ranks should be uniform. A
posterior that collapsed has no interval.
"""

from __future__ import annotations

import argparse

import numpy as np
from pendulum_truths import drawn
from scipy.stats import kstest

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import Particle, ParticleTrials, Trial, policy_of
from sim.adaptation.methods import make_method
from sim.adaptation.posterior import Posterior, likelihood_of, posterior
from sim.tasks import get_task

INTERVAL = (0.05, 0.95)


def rank(known: Posterior, truth: Array) -> Array:
    """(p,) posterior probability below the truth (p,)."""
    return np.asarray(((known.samples < truth) * known.weights[:, None]).sum(axis=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=5209)
    parser.add_argument("--truths", type=int, default=200, help="of each kind")
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation, as a fraction of each range")
    asked = parser.parse_args()
    task, rng = get_task("pendulum"), np.random.default_rng(asked.seed)
    checkpoint = load_checkpoint(task)
    solver, nothing, context = checkpoint.solver, np.zeros((1, 0)), np.zeros(0)
    method = make_method("adaptsim", task, checkpoint)
    particles = method.start(2, rng)
    actions = [policy_of(method, solver, particle, ()).actions(np.zeros((1, 0)))[0] for particle in particles]
    print("| truths | | " + " | ".join(task.parameters.names) + " |\n" + "|---" * (2 + len(task.parameters)) + "|")
    for kind, truths in drawn(asked.seed, asked.truths).items():
        ranks, widths, holds = [], [], []
        for truth in truths:
            trials = []
            for action in actions:
                path = solver.trajectories(truth[None], action[None], nothing)[0]
                seen = path + asked.noise * rng.standard_normal(path.shape)
                trials.append(Trial(context, action, seen, 0.0, np.zeros(1)))
            known = posterior(likelihood_of(checkpoint), ((ParticleTrials(Particle(truth[None]), tuple(trials)),),))
            if known.is_collapsed:
                continue
            low, high = known.quantiles(INTERVAL)
            ranks.append(rank(known, truth))
            widths.append(known.space.normalise(high) - known.space.normalise(low))
            holds.append((low <= truth) & (truth <= high))
        tests = [kstest(column, "uniform").pvalue for column in np.array(ranks).T]
        for what, values, form in (
            ("held in 90 %", np.mean(holds, axis=0), "{:.3f}"),
            ("median width, share of the margin", np.median(widths, axis=0), "{:.4f}"),
            ("p of uniform ranks", tests, "{:.3f}"),
        ):
            print(
                f"| {len(ranks)} of {len(truths)} {kind} | {what} | "
                + " | ".join(form.format(v) for v in values)
                + " |",
                flush=True,
            )


if __name__ == "__main__":
    main()
