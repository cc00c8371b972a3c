"""Two goals, one bottle (the paper's Figure A7): pushing, world heavy-bottle, what each session infers.

Trials come from the world's table: adaptsim world-tables --task pushing --targets heavy-bottle
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hw.types import Array
from sim.adaptation.method import Iteration, Method
from sim.adaptation.methods import make_method
from sim.research.benchmark.places import Place
from sim.research.benchmark.sessions import Conditions, run_session
from sim.solvers.solver import Solver
from sim.tasks.task import Task
from sim.types import Space
from studies.shared import COLOURS, Asked, Watched, interval, plot, save, table, table_of

GOALS, TARGET = ((0.80, 0.10), (0.95, -0.10)), "heavy-bottle"
"""Distance ahead of the arm's base in m, bearing from the bottle's start in rad."""
METHODS, CONDITIONS, JUDGED = ("adaptsim", "adaptsim-iteration"), Conditions(budget=20), 64


def run(asked: Asked) -> None:
    """Run the sessions, print the table, draw those of seed 0."""
    rows, (checkpoint, place) = asked.rows, table_of("pushing", TARGET)
    task = checkpoint.solver.task
    found = dict[tuple[str, int], list[dict[str, Any]]]()
    for method in METHODS:
        for k, goal in enumerate(GOALS):
            for seed in range(asked.seeds):
                row = rows.row(
                    f"{method}, goal {goal}",
                    seed,
                    partial(
                        _one, checkpoint.solver, make_method(method, task, checkpoint), place, np.array(goal), seed
                    ),
                )
                found.setdefault((method, k), []).append(row)
    body = [[method, _where(GOALS[k]), *_told(task, GOALS[k], rows_)] for (method, k), rows_ in found.items()]
    names = [f"{d.title}, last" for d in task.parameters.dimensions]
    print(table(["method", "goal", "from the goal, first iteration", "last", "reward", *names], body))
    _draw(task, {key: rows_[0] for key, rows_ in found.items()}, asked)


def _one(solver: Solver, method: Method, place: Place, goal: Array, seed: int) -> dict[str, Any]:
    """A session with the same goal in every trial."""
    task, histories = solver.task, list[Sequence[Iteration]]()
    watched = Watched(method, histories.append)
    policies = run_session(solver, watched, place, CONDITIONS, seed, at(task, goal))
    history, contexts = histories[-1], np.tile(goal, (JUDGED, 1))
    rng = np.random.default_rng(seed)
    return {
        "ends_m": [
            [None if trial.end_state is None else trial.end_state.tolist() for p in iteration for trial in p.trials]
            for iteration in history
        ],
        "means": [[p.particle.mean.tolist() for p in iteration] for iteration in history],
        "reward": [float(place.judge(contexts, policy.actions(contexts), rng).mean()) for policy in policies],
    }


def at(task: Task, context: Array) -> Space:
    """A space of nothing but one context."""
    rows = zip(task.context.dimensions, context, strict=True)
    return replace(task.context, dimensions=tuple(replace(d, low=float(x), high=float(x)) for d, x in rows))


def _where(goal: tuple[float, float]) -> str:
    return f"{goal[0]:.2f} m, {goal[1]:+.2f} rad"


def _off_mm(task: Task, goal: tuple[float, float], ends: Sequence[Any]) -> float:
    """Mean distance from the goal of the trials in which the bottle stood, NaN if it never did."""
    assert task.goal_m is not None
    wanted = task.goal_m(np.array(goal))
    off = [1e3 * np.linalg.norm(np.array(end[:2]) - wanted) for end in ends if end is not None]
    return float(np.mean(off)) if off else float("nan")


def _told(task: Task, goal: tuple[float, float], rows: Sequence[dict[str, Any]]) -> list[str]:
    first, last = (np.nanmean([_off_mm(task, goal, row["ends_m"][i]) for row in rows]) for i in (0, -1))
    means = np.array([np.mean(row["means"][-1], axis=0) for row in rows])
    spread = [f"{m:.3g} ± {d:.2g}" for m, d in zip(means.mean(axis=0), means.std(axis=0), strict=True)]
    return [f"{first:.0f} mm", f"{last:.0f} mm", interval([row["reward"][-1] for row in rows]), *spread]


def _draw(task: Task, rows: dict[tuple[str, int], dict[str, Any]], asked: Asked) -> None:
    assert task.goal_m is not None
    plt = plot()
    figure, grid = plt.subplots(len(rows), 2, figsize=(7.6, 2.1 * len(rows)), layout="constrained")
    for (table_axes, line_axes), ((method, k), row) in zip(grid, rows.items(), strict=True):
        wanted = task.goal_m(np.array(GOALS[k]))
        for i, ends in enumerate(row["ends_m"]):
            shown = np.array([end[:2] for end in ends if end is not None]).reshape(-1, 2)
            table_axes.scatter(*shown.T, s=18, color=plt.cm.viridis(i / (len(row["ends_m"]) - 1)), label=str(i + 1))
        table_axes.scatter(*wanted, marker="x", s=70, color="#d1661f")
        table_axes.set(
            title=f"{method}, goal {k + 1}", xlabel="x [m]", ylabel="y [m]", xlim=(0.6, 1.2), ylim=(-0.2, 0.2)
        )
        unit = task.parameters.normalise(np.array(row["means"]).mean(axis=1))
        for colour, name, values in zip(COLOURS, task.parameters.names, unit.T, strict=False):
            line_axes.plot(np.arange(len(values)) + 1, values, color=colour, label=name, marker="o", ms=3)
        line_axes.set(xlabel="iteration", ylabel="fraction of the range", ylim=(-0.05, 1.05))
    grid[0, 0].legend(title="iteration", fontsize=7, frameon=False)
    grid[0, 1].legend(fontsize=7, frameon=False)
    save(figure, asked)
