"""The adaptation step delta (the paper's Figure A6): double pendulum, world ood-1, the paper's adaptation policy.

Trained anew for each delta of .05, .10, .15 and .20 of the ranges; ten iterations.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from sim.research.benchmark.sessions import Conditions
from sim.tasks import get_task
from studies.shared import COLOURS, Asked, interval, plot, save, session, simulated, table, trained

DELTAS = (0.05, 0.10, 0.15, 0.20)
TARGET, CONDITIONS = "ood-1", Conditions(budget=20)
METHOD = "adaptsim-iteration"


def run(asked: Asked) -> None:
    """Train, run the sessions, print the table, draw."""
    rows, curves = asked.rows, dict[float, list[list[float]]]()
    for delta in DELTAS:
        for training in range(asked.trainings):
            task = get_task("pendulum")
            task = replace(task, adaptation=replace(task.adaptation, delta=delta))
            checkpoint = trained(task, asked.folder / f"delta{delta:.2f}-training{training}", training)
            place = simulated(checkpoint, TARGET)
            for seed in range(asked.seeds):
                row = rows.row(
                    f"delta {delta:.2f}, training {training}",
                    seed,
                    partial(session, checkpoint, METHOD, place, CONDITIONS, seed),
                )
                curves.setdefault(delta, []).append(row["reward"])
    iterations = len(curves[DELTAS[0]][0])
    shown = sorted({0, 1, 2, 4, iterations - 1})
    body = [
        [f"{delta:.2f}", *(interval([c[i] for c in curves[delta]]) for i in shown), f"{_unrest(curves[delta]):.3f}"]
        for delta in DELTAS
    ]
    print(table(["delta", *(f"after iteration {i + 1}" for i in shown), "mean change in the last five"], body))
    plt = plot()
    figure, axes = plt.subplots(figsize=(5.2, 3.2), layout="constrained")
    for colour, delta in zip(COLOURS, DELTAS, strict=False):
        found = np.array(curves[delta])
        axes.plot(
            np.arange(iterations) + 1, found.mean(axis=0), color=colour, label=f"δ = {delta:.2f}", marker="o", ms=3
        )
        low, high = np.quantile(found, (0.25, 0.75), axis=0)
        axes.fill_between(np.arange(iterations) + 1, low, high, color=colour, alpha=0.12, lw=0)
    axes.set(xlabel="iteration", ylabel="reward (mean, quartiles)", ylim=(0, 1.02))
    axes.legend(frameon=False)
    save(figure, asked)


def _unrest(curves: list[list[float]]) -> float:
    """By how much the reward still changes from one iteration to the next, in the last five."""
    return float(np.abs(np.diff(np.array(curves)[:, -6:], axis=1)).mean())
