"""The cost of a rollout, and its accuracy.

    python benchmarks/rollouts.py --task scooping --count 400 --cache build/convergence

Draws parameters, actions and nuisance over their ranges, runs each with the step of training and with a quarter of it
(same mesh, same contact model), and prints how often the outcome agrees, how far the object's XY lies apart at the
observed times and at the end, and what a rollout costs on one core. Both steps take turns, so that a busy computer
slows both alike. Finished rollouts are stored in the cache; a stopped run continues.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept import Kept
from scipy.stats import qmc

from hw.types import Array
from sim.tasks import get_task
from sim.tasks.fingerprint import scene_key
from sim.tasks.task import Task

FINER = 4


@dataclass(frozen=True, eq=False)
class Measured:
    """Rollouts with one step, in the order of the draws."""

    outcome: list[str]
    succeeded: Array  # (n,) 0 or 1
    xy_m: Array  # (n, M, 2) at the times of the observation
    end_m: Array  # (n, 2) where it ended
    cpu_s: Array  # (n,)


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    draws = draw(task, arguments.count)
    step_s = task.require_hardware().time_step_s(None)
    coarse, fine = measure(
        task, draws, (step_s, step_s / FINER), Path(arguments.cache) / f"{task.name}-{scene_key(task)}.jsonl"
    )
    print(f"{task.name}: {arguments.count} rollouts over the ranges, {1e3 * step_s:g} ms against a quarter of it")
    print(
        "outcome agrees | success (quarter) | XY apart, mm: median of all times, end median / p90, "
        "end median where both succeed | CPU ms"
    )
    print(compare(coarse, fine))


def draw(task: Task, count: int) -> list[tuple[Array, Array, Array]]:
    """(parameters, action, nuisance) over their ranges, space filling; integers go round."""
    spaces = (task.parameters, task.action, task.nuisance)
    unit = qmc.Sobol(sum(map(len, spaces)), seed=0).random(count)
    parts = np.split(unit, np.cumsum([len(s) for s in spaces])[:-1], axis=1)
    parameters, actions, nuisance = (space.denormalise(u) for space, u in zip(spaces, parts, strict=True))
    for i, d in enumerate(task.parameters.dimensions):
        if d.scale == "integer":
            parameters[:, i] = d.low + np.arange(count) % (d.high - d.low + 1)
    return list(zip(parameters, actions, nuisance, strict=True))


def measure(
    task: Task, draws: Sequence[tuple[Array, Array, Array]], steps_s: Sequence[float], cache: Path
) -> list[Measured]:
    """Every draw with each step, from the cache as far as it goes."""
    cache.parent.mkdir(parents=True, exist_ok=True)
    store, rows = Kept(cache), [list[dict[str, Any]]() for _ in steps_s]
    for number, draw in enumerate(draws):
        for step_s, step_rows in zip(steps_s, rows, strict=True):
            step_rows.append(store.row(f"{1e6 * step_s:.0f} us", number, partial(rolled, task, draw, step_s)))
    return [_measured(task, step_rows) for step_rows in rows]


def rolled(task: Task, draw: tuple[Array, Array, Array], step_s: float) -> dict[str, Any]:
    """One rollout."""
    parameters, action, nuisance = draw
    before_s = time.process_time()
    track = task.simulate(parameters, task.reference_context, action, nuisance, task.unmodelled(dt_s=step_s))
    return {
        "cpu_s": time.process_time() - before_s,
        "outcome": track.outcome.value,
        "succeeded": float(task.succeeded(track)),
        "state": track.at(task.observation.times_s).tolist(),
        "end": track.state[-1].tolist(),
    }


def _measured(task: Task, rows: Sequence[dict[str, Any]]) -> Measured:
    columns = list(task.observation.columns)
    xy_m = np.array([row["state"] for row in rows])[:, :, columns]
    succeeded, end_m, cpu_s = (np.array([row[name] for row in rows]) for name in ("succeeded", "end", "cpu_s"))
    return Measured([row["outcome"] for row in rows], succeeded, xy_m, end_m[:, columns], cpu_s)


def compare(coarse: Measured, fine: Measured) -> str:
    """One row of the table."""
    agree = np.array([a == b for a, b in zip(coarse.outcome, fine.outcome, strict=True)])
    share, standard_error = agree.mean(), np.sqrt(agree.mean() * (1.0 - agree.mean()) / len(agree))
    apart_mm = 1e3 * np.linalg.norm(coarse.xy_m - fine.xy_m, axis=-1)
    end_mm = 1e3 * np.linalg.norm(coarse.end_m - fine.end_m, axis=-1)
    both = (coarse.succeeded > 0.0) & (fine.succeeded > 0.0)
    success = [m.succeeded.mean() for m in (coarse, fine)]
    failed = sum(o == "solver_failed" for o in (*coarse.outcome, *fine.outcome))
    return (
        f"{share:.3f} +- {standard_error:.3f} | {success[0]:.2f} ({success[1]:.2f}) | {np.median(apart_mm):.1f}, "
        f"{np.median(end_mm):.1f} / {np.percentile(end_mm, 90):.0f}, {np.median(end_mm[both]):.1f} | "
        f"{1e3 * coarse.cpu_s.mean():.0f}" + (f" | {failed} solver failures" if failed else "")
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--cache", default="build/convergence")
    return parser.parse_args()


if __name__ == "__main__":
    main()
