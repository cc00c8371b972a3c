"""Ranges that move away from the truth (the paper's Figure A3): double pendulum, world ood-1, where m2 is 0.3 kg.

Omega's range of m2 is [1, 2] and then moves up by 0.1, 0.2 and 0.3 kg; all is trained anew for each.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from sim.research.benchmark.sessions import Conditions
from sim.tasks import get_task
from sim.tasks.task import Task
from sim.types import Space
from studies.shared import COLOURS, Asked, bounds, interval, plot, save, session, simulated, table, trained

SHIFTS_KG = (0.0, 0.1, 0.2, 0.3)
METHODS = ("adaptsim", "adaptsim-iteration", "sysid-bayes", "sysid-bayes-point", "random", "udr")
TARGET, CONDITIONS = "ood-1", Conditions(budget=10)


def run(asked: Asked) -> None:
    """Train, run the sessions, print the table, draw."""
    rows, earned = asked.rows, dict[tuple[str, float], list[float]]()
    for shift_kg in SHIFTS_KG:
        for training in range(asked.trainings):
            task = shifted(get_task("pendulum"), shift_kg)
            checkpoint = trained(task, asked.folder / f"m2+{shift_kg:.1f}-training{training}", training)
            place = simulated(checkpoint, TARGET)
            for method in METHODS:
                for seed in range(asked.seeds):
                    case = f"m2+{shift_kg:.1f}, training {training}, {method}"
                    row = rows.row(case, seed, partial(session, checkpoint, method, place, CONDITIONS, seed))
                    earned.setdefault((method, shift_kg), []).append(row["reward"][-1])
                print(f"{case}: {interval(earned[method, shift_kg])}", flush=True)
    head = ["method", *(f"m2 in [{1 + s:.1f}, {2 + s:.1f}] kg" for s in SHIFTS_KG)]
    print(table(head, [[m, *(interval(earned[m, s]) for s in SHIFTS_KG)] for m in METHODS]))
    plt = plot()
    figure, axes = plt.subplots(figsize=(5.2, 3.2), layout="constrained")
    for k, method in enumerate(METHODS):
        found = np.array([bounds(np.array(earned[method, s])) for s in SHIFTS_KG])
        lows = 1 + np.array(SHIFTS_KG) + 0.006 * (k - 2)
        errors = np.abs(found[:, 1:].T - found[:, 0])
        colour = (*COLOURS, "black")[k]
        axes.errorbar(lows, found[:, 0], errors, label=method, marker="o", ms=3.5, capsize=2, color=colour, lw=1.2)
    axes.set(xlabel="lower end of the range of m2 in Omega [kg]; the truth is 0.3 kg", ylabel="reward", ylim=(0, 1.02))
    axes.legend(frameon=False, fontsize=8)
    save(figure, asked)


def shifted(task: Task, by_kg: float) -> Task:
    """The pendulum with another range of m2; its margin holds the range and the truth, as before."""

    def moved(space: Space, low_kg: float) -> Space:
        rows = (replace(d, low=d.low + low_kg, high=d.high + by_kg) if d.name == "m2" else d for d in space.dimensions)
        return replace(space, dimensions=tuple(rows))

    return replace(task, parameters=moved(task.parameters, by_kg), margin=moved(task.margin, 0.0))
