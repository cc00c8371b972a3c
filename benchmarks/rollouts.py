"""What a rollout costs and how far it can be trusted.

    python benchmarks/rollouts.py --task scooping --count 400 --cache build/convergence

Draws parameters, actions and nuisance over their ranges, runs each with the step of training and with a quarter of it
(same mesh, same contact model), and prints how often the outcome agrees, how far the object's XY lies apart at the
observed times and at the end, what a rollout costs on one core, and how much more the same rollout costs with a whole
arm. With --all also for other steps and the other contact model, with --cenic also for an integrator that chooses its
steps: against its own limit, and against that of training. Finished rollouts are kept in the cache; an interrupted run
goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import cenic
import numpy as np
from scipy.stats import qmc

from hw.types import Array
from sim.tasks import get_task
from sim.tasks.scene_key import scene_key
from sim.tasks.task import Task

COARSER = 4
ACCURACIES, LIMIT = (1e-2, 1e-3), 1e-6
"""Of CENIC, and the one that stands for its limit."""


@dataclass(frozen=True, eq=False)
class Setting:
    """One way to step the same scene."""

    contact: str
    dt_s: float
    accuracy: float | None = None  # None: fixed steps; else CENIC's

    def __str__(self) -> str:
        return f"CENIC, {self.accuracy:g}" if self.accuracy else f"{self.contact:>6}, {1e3 * self.dt_s:5.3f} ms"

    @property
    def file(self) -> str:
        """Its part of the name in the cache."""
        return f"cenic-{self.accuracy:g}" if self.accuracy else f"{self.contact}-{1e6 * self.dt_s:.0f}us"


@dataclass(frozen=True, eq=False)
class Measured:
    """Rollouts of one setting, in the order of the draws."""

    outcome: list[str]
    succeeded: Array  # (n,) 0 or 1
    xy_m: Array  # (n, M, 2) at the times of the observation
    end_m: Array  # (n, 2) where it ended
    cpu_s: Array  # (n,)


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    draws = draw(task, arguments.count)
    chosen = Setting(task.unmodelled().contact, task.require_hardware().time_step_s(None))
    cache = Path(arguments.cache) / scene_key(task)
    settings = [chosen]
    if arguments.all:
        settings += [Setting(c, dt) for c in ("sap", "lagged") for dt in (0.005, 0.002, 0.001)]
        settings = [s for i, s in enumerate(settings) if str(s) not in map(str, settings[:i])]
    print(
        f"{task.name}: {arguments.count} rollouts over the ranges, against a quarter of the step (same mesh and model)"
    )
    print(
        "setting | outcome agrees | success (quarter) | XY apart, mm: median of all times, end median / p90, "
        "end median where both succeed | "
        "CPU ms (quarter)"
    )
    for setting in settings:
        coarse = measure(task, draws, setting, cache)
        fine = measure(task, draws, Setting(setting.contact, setting.dt_s / COARSER), cache)
        print(f"{setting} {'<- training' if setting is chosen else '':11} | {compare(coarse, fine)}", flush=True)
    if arguments.cenic:
        limits = [Setting(chosen.contact, chosen.dt_s, LIMIT), Setting(chosen.contact, chosen.dt_s / COARSER)]
        for accuracy in ACCURACIES:
            candidate = measure(task, draws, replace(chosen, accuracy=accuracy), cache)
            for limit in limits:
                row = compare(candidate, measure(task, draws, limit, cache))
                print(f"CENIC, {accuracy:g}, against {limit} | {row}", flush=True)
    if arguments.arm:
        alone_s = measure(task, draws, chosen, cache).cpu_s[: arguments.arm].mean()
        whole_s = whole_arm_cpu_s(task, draws, arguments.arm)
        print(f"with a whole arm: {1e3 * whole_s:.0f} ms, {whole_s / alone_s:.1f} times the rollout of training")


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


def measure(task: Task, draws: list[tuple[Array, Array, Array]], setting: Setting, cache: Path) -> Measured:
    """Every draw with `setting`, from the cache as far as it goes."""
    file = cache / f"{task.name}-{setting.file}-ends.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    with file.open("a") as out:
        for row in _rollouts(task, draws[len(rows) :], setting):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
    rows = rows[: len(draws)]
    columns = list(task.observation.columns)
    xy_m = np.array([row["state"] for row in rows])[:, :, columns]
    succeeded, end_m, cpu_s = (np.array([row[name] for row in rows]) for name in ("succeeded", "end", "cpu_s"))
    return Measured([row["outcome"] for row in rows], succeeded, xy_m, end_m[:, columns], cpu_s)


def _rollouts(task: Task, draws: list[tuple[Array, Array, Array]], setting: Setting) -> Iterator[dict[str, object]]:
    unmodelled = task.unmodelled(contact=setting.contact, dt_s=setting.dt_s)
    for parameters, action, nuisance in draws:
        with cenic.stepping(task, setting.accuracy) if setting.accuracy else nullcontext():
            before_s = time.process_time()
            track = task.simulate(parameters, task.reference_context, action, nuisance, unmodelled)
            cpu_s = time.process_time() - before_s
        states = track.at(task.observation.times_s).tolist()
        succeeded, end = float(task.succeeded(track)), track.state[-1].tolist()
        yield {"outcome": track.outcome.value, "succeeded": succeeded, "state": states, "end": end, "cpu_s": cpu_s}


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
        f"{1e3 * coarse.cpu_s.mean():.0f} ({1e3 * fine.cpu_s.mean():.0f})"
        + (f" | {failed} solver failures" if failed else "")
    )


def whole_arm_cpu_s(task: Task, draws: list[tuple[Array, Array, Array]], count: int) -> float:
    """CPU time of a rollout in the lab's cell: the same scene, carried by a whole arm (building it included)."""
    hardware = task.require_hardware()
    from sim.lab.cell import Cell  # noqa: PLC0415 - only where there is a lab
    from sim.lab.world import Faults, Sensing, World  # noqa: PLC0415
    from sim.panda.planning import home, trial_paths  # noqa: PLC0415
    from sim.panda.tool import cell_as_shipped  # noqa: PLC0415

    shipped, spent_s = cell_as_shipped(hardware, "panda"), 0.0
    q_home = home(hardware.X_FT, shipped)
    for parameters, action, nuisance in draws[:count]:
        motion = hardware.plan(task.reference_context, action)
        path = trial_paths(motion, hardware.X_FT, shipped, q_home)[1]
        effects = task.unmodelled()
        before_s = time.process_time()
        cell = Cell(task, World("nominal", task.name, "", parameters, nuisance, effects, Sensing(), Faults()))
        cell.reset(path.q_rad[0], hardware.rest_pose(task.reference_context, parameters, nuisance, effects))
        cell.simulate(path.t_s, path.q_rad)
        spent_s += time.process_time() - before_s
    return spent_s / count


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--arm", type=int, default=20, help="rollouts with a whole arm; 0 for none")
    parser.add_argument("--all", action="store_true", help="also other steps and the other contact model")
    parser.add_argument("--cenic", action="store_true", help="also CENIC, an integrator that chooses its steps")
    parser.add_argument("--cache", default="build/convergence")
    return parser.parse_args()


if __name__ == "__main__":
    main()
