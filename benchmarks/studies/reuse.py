"""Reuse of task policies (the paper's A2.2), with NAF in the loop: scooping, sessions of the paper's adaptation policy.

Every task policy is trained by NAF on true rollouts, at `SCALE` of the budgets of Table A1: by the rules of reuse, and
anew for every E. Trials and scores are true rollouts in the world.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.methods import make_method
from sim.research.benchmark.places import Place
from sim.research.benchmark.sessions import Conditions, judge, run_session
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, rules_of
from sim.rollouts.cache import CachedRollouts
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import Requests, Rollouts
from sim.tasks import get_task
from studies.shared import Asked, Watched, plot, save, simulated, table

TARGET, METHOD, SCALE, CONDITIONS = "soft-cheese", "adaptsim-iteration", 0.25, Conditions(budget=20, judged=16)
WAYS = {"by the rules": True, "anew for every E": False}


def run(asked: Asked) -> None:
    """Run the sessions, print the table, draw."""
    rows, checkpoint = asked.rows, load_checkpoint(get_task("scooping"))
    place = simulated(checkpoint, TARGET)
    found = dict[str, list[dict[str, Any]]]()
    for way, reusing in WAYS.items():
        for seed in range(asked.seeds):
            row = rows.row(way, seed, partial(_session, asked, checkpoint, place, seed, reusing=reusing))
            found.setdefault(way, []).append(row)
            print(f"{way}, seed {seed}: {row}", flush=True)
    body = [
        [
            way,
            *(f"{sum(row[key] for row in rows_) / len(rows_):.0f}" for key in ("policies", "rollouts")),
            ", ".join(f"{row['reward'][-1]:.2f}" for row in rows_),
        ]
        for way, rows_ in found.items()
    ]
    print(table(["task policies", "asked for", "rollouts of training", "final reward, each seed"], body))
    plt = plot()
    figure, axes = plt.subplots(figsize=(5.0, 3.0), layout="constrained")
    for colour, (way, rows_) in zip(("#1f5fa8", "#d1661f"), found.items(), strict=True):
        for row in rows_:
            axes.plot(row["spent"], row["reward"], marker="o", ms=3, color=colour, label=way)
    axes.set(xlabel="rollouts of training so far", ylabel="reward after each iteration", ylim=(0, 1.02))
    axes.legend(*_once(axes), frameon=False)
    save(figure, asked)


def _session(asked: Asked, checkpoint: Checkpoint, place: Place, seed: int, *, reusing: bool) -> dict[str, Any]:
    task, rules = checkpoint.solver.task, rules_of(checkpoint.solver.task, SCALE)
    rules = rules if reusing else replace(rules, distance=0.0)
    with serial_executor() as crew:
        cached = CachedRollouts(task, asked.folder / f"rollouts-{'reuse' if reusing else 'anew'}-{seed}", crew)
        asked_for, spent = list[int](), list[int]()

        def roll(requests: Requests) -> Rollouts:
            asked_for.append(len(requests))
            return cached(requests)

        solver = NafSolver(task, roll, rules, NafMemory(task))
        method = Watched(make_method(METHOD, task, checkpoint), lambda _: spent.append(sum(asked_for)))
        policies = run_session(solver, method, place, CONDITIONS, seed)
    return {
        "policies": len(solver.memory.record),
        "rollouts": sum(asked_for),
        "spent": spent,
        "reward": [judge(task, policy.actions, place, CONDITIONS, seed).reward for policy in policies],
    }


def _once(axes: Any) -> tuple[list[Any], list[str]]:
    """Each label of a legend once."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    return list(unique.values()), list(unique)
