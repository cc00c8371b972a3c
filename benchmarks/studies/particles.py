"""N, the number of particles (the paper's Figure A5): pushing, world light-bottle, reward against real trials.

Trials come from the world's table: adaptsim world-tables --task pushing --targets light-bottle
"""

from __future__ import annotations

from functools import partial

import numpy as np

from sim.research.benchmark.sessions import Conditions
from studies.shared import COLOURS, Asked, interval, plot, save, session, table, table_of

COUNTS, BUDGET, TARGET = (1, 2, 3, 4), 24, "light-bottle"
METHODS = ("adaptsim-iteration", "adaptsim")


def run(asked: Asked) -> None:
    """Run the sessions, print the table, draw."""
    rows, (checkpoint, place) = asked.rows, table_of("pushing", TARGET)
    each = checkpoint.solver.task.adaptation.trials_per_iteration
    curves = dict[tuple[str, int], list[list[float]]]()
    for method in METHODS:
        for count in COUNTS:
            conditions = Conditions(BUDGET, particles=count)
            for seed in range(asked.seeds):
                row = rows.row(
                    f"{method}, N = {count}",
                    seed,
                    partial(session, checkpoint, method, place, conditions, seed),
                )
                curves.setdefault((method, count), []).append(row["reward"])
            print(f"{method}, N = {count}: {interval([c[-1] for c in curves[method, count]])}", flush=True)
    shown = (8, 16, 24)
    body = [
        [
            method,
            str(count),
            *(interval([c[trials // (each * count) - 1] for c in curves[method, count]]) for trials in shown),
        ]
        for method in METHODS
        for count in COUNTS
    ]
    print(table(["method", "N", *(f"after {trials} trials" for trials in shown)], body))
    plt = plot()
    figure, both = plt.subplots(1, len(METHODS), figsize=(7.4, 3.0), sharey=True, layout="constrained")
    for axes, method in zip(both, METHODS, strict=True):
        for colour, count in zip(COLOURS, COUNTS, strict=False):
            found = np.array(curves[method, count])
            trials = each * count * (np.arange(found.shape[1]) + 1)
            axes.plot(trials, found.mean(axis=0), color=colour, marker="o", ms=3, label=f"N = {count}")
        axes.set(title=method, xlabel="real trials", ylim=(0, 1.02))
    both[0].set_ylabel("reward")
    both[0].legend(frameon=False)
    save(figure, asked)
