"""The paper's simulated targets and its further studies (appendix A5.1 and A5.3) in the pendulum.

    python benchmarks/paper_settings.py table      Table A2: every method in the five targets
    python benchmarks/paper_settings.py figure-a3  OOD-1, while the range of m2 moves away from the target
    python benchmarks/paper_settings.py figure-a5  one to four particles, with the same number of trials
    python benchmarks/paper_settings.py figure-a6  OOD-1, with steps of the adaptation policy from 0.05 to 0.20

Every session is a line of docs/results/paper-settings.csv; those that are there do not run again. `make docs` writes
the page and its figures from these lines alone.

In A3 and A6 the paper's policy is the shipped one, which was trained for the usual range and step. It sees parameters
as fractions of their ranges, so it can be used with others, but it is not trained again.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from results import Session, read, write

from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.methods import ignores_seed
from sim.lab.world import load_world
from sim.research.benchmark.entries import FIXED_RULES, LIMITS, Entry, fixed_policies, make_entry
from sim.research.benchmark.knowledge import with_ranges
from sim.research.benchmark.sessions import Conditions, choose_oracle, estimated_reward, run_session
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.tasks import get_task
from sim.types import Space

STORED = Path("docs/results/paper-settings.csv")
TARGETS = ("wd", "ood-1", "ood-2", "ood-3", "ood-4")
TRIALS, EXACT_TRIALS = 10, 4
"""Trials of a session, and those of methods that fit an exact simulator."""

SEEDS, FIGURE_SEEDS = 5, 10
"""Sessions of a method that draws: in each of the five targets, and in one target alone."""

PAPER, SYSID = "adaptsim-iteration", "least-squares@omega"
"""The paper's policy, and system identification in Omega: the parameters of Omega that repeat the trials best."""

TABLE_ENTRIES = (
    "adaptsim", PAPER, "adaptsim-state", "adaptsim-history", "bo-prior", "random",
    "learn-in-target", "least-squares", SYSID, "udr", "udr-mean", "oracle", "best-action",
)  # fmt: skip
EXACT = ("adaptsim", "least-squares", SYSID)
"""They use that the pendulum's simulator is exact: further trials change nothing."""
SHIFTS = (0.0, 0.1, 0.2, 0.3)
STEPS = (0.05, 0.10, 0.15, 0.20)
PARTICLES = (1, 2, 3, 4)
SHARED_TRIALS = 24
"""Trials of a session in figure A5: a whole number of iterations for each number of particles."""


@dataclass(frozen=True)
class Setting:
    """One session that a table or figure needs, but for its seed."""

    part: str  # e.g. "figure-a6 0.05"
    world: str
    entry: str
    shift: float = 0.0  # of the range of m2, in kg
    delta: float = 0.0  # step of the adaptation policy; 0: the task's
    particles: int = 2
    trials: int = TRIALS


def settings(wanted: str) -> Iterator[Setting]:
    """All settings of a table or figure."""
    if wanted == "table":
        for entry in TABLE_ENTRIES:
            trials = EXACT_TRIALS if entry in EXACT else TRIALS
            yield from (Setting("table", world, entry, trials=trials) for world in TARGETS)
    elif wanted == "figure-a3":
        entries = (PAPER, SYSID, "udr", "oracle")
        yield from (Setting(f"{wanted} {s:g}", "ood-1", entry, shift=s) for entry in entries for s in SHIFTS)
    elif wanted == "figure-a5":
        yield from (
            Setting(f"{wanted} {n}", world, PAPER, particles=n, trials=SHARED_TRIALS)
            for n in PARTICLES
            for world in TARGETS
        )
    else:
        yield from (Setting(f"{wanted} {d:g}", "ood-1", PAPER, delta=d, trials=2 * TRIALS) for d in STEPS)


def session_of(setting: Setting, seed: int) -> Session:
    """Run one session, or judge a rule or limit."""
    entry = Entry.parse(setting.entry)
    checkpoint = _checkpoint(setting.shift, setting.delta, entry)
    solver, task = checkpoint.solver, checkpoint.solver.task
    place = SimulatedTrials(solver, load_world(setting.world, get_task("pendulum")))
    conditions = Conditions(setting.trials, setting.particles)
    if entry.name in FIXED_RULES:
        acts = [policy.actions for policy in fixed_policies(entry.name, checkpoint, seed)]
    elif entry.name in LIMITS:
        best = choose_oracle(solver, place, conditions, seed)[0].actions if entry.name == "oracle" else None
        acts = [best or place.best_actions]
    else:
        policies = run_session(solver, make_entry(entry.name, task, checkpoint), place, conditions, seed)
        acts = [policy.actions for policy in policies]
    earned = [estimated_reward(task, act, place, conditions, seed).mean for act in acts]
    if entry.name in FIXED_RULES:
        return Session(setting.part, setting.world, setting.entry, seed, round(sum(earned) / len(earned), 4), ())
    each = setting.particles * task.adaptation.trials_per_iteration
    after = () if entry.name in LIMITS else tuple((each * (k + 1), round(r, 4)) for k, r in enumerate(earned))
    return Session(setting.part, setting.world, setting.entry, seed, round(earned[-1], 4), after)


@cache
def _checkpoint(shift: float, delta: float, entry: Entry) -> Checkpoint:
    """The shipped checkpoint with another range of m2, another step, and the ranges that an entry is told."""
    shipped = load_checkpoint(get_task("pendulum"))
    task, behind = shipped.solver.task, shipped.solver
    if shift:
        moved = (
            replace(d, low=d.low + shift, high=d.high + shift) if d.name == "m2" else d
            for d in task.parameters.dimensions
        )
        task = replace(task, parameters=Space(tuple(moved)))
    if delta:
        task = replace(task, adaptation=replace(task.adaptation, delta=delta))
    solver: Any = replace(behind, task=task)  # type: ignore[type-var]  # the pendulum's, a dataclass
    checkpoint = replace(shipped, solver=solver)
    if entry.ranges is None:
        return checkpoint
    return with_ranges(checkpoint, entry.ranges, tabulated=entry.needs_reward_table)


def seeds_of(setting: Setting) -> range:
    """The seeds of a setting: one if each would give the same session."""
    name, task = Entry.parse(setting.entry).name, get_task("pendulum")
    if ignores_seed(name, task) or name in (*LIMITS, *EXACT, "udr-mean"):
        return range(1)
    return range(SEEDS if setting.part.startswith(("table", "figure-a5")) else FIGURE_SEEDS)


def main() -> None:
    logging.getLogger("drake").setLevel(logging.ERROR)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wanted", choices=("table", "figure-a3", "figure-a5", "figure-a6"))
    parser.add_argument("--entries", default="", help="only these, separated by commas")
    asked = parser.parse_args()
    only = [name for name in asked.entries.split(",") if name]
    for setting in settings(asked.wanted):
        for seed in seeds_of(setting) if not only or setting.entry in only else ():
            sessions = {(s.part, s.world, s.method, s.seed): s for s in read(STORED)}
            key = (setting.part, setting.world, setting.entry, seed)
            if key not in sessions:
                sessions[key] = session_of(setting, seed)
                write(STORED, [sessions[k] for k in sorted(sessions)])
            print(*key, sessions[key].reward, flush=True)


if __name__ == "__main__":
    main()
