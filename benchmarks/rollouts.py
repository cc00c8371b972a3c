"""What a rollout costs and how far it can be trusted.

    python benchmarks/rollouts.py --task scooping --count 400 --cache build/convergence

Draws parameters, actions and nuisance over their ranges, runs each with the step of training and with a quarter of it
(same mesh, same contact model), and prints how often the outcome agrees, how far the object's XY lies apart at the
observed times and at the end, what a rollout costs on one core, and how much more the same rollout costs with a whole
arm. With --all also every candidate for something cheaper, against the same quarter: other steps, the other contact
model, a coarser mesh, a longer step after the impact, an integrator that chooses its steps (CENIC), another engine
(MuJoCo); with --later of these only the longer step. With --cenic also CENIC against its own limit. All settings take
turns at each few draws, so that a busy computer slows all alike. Finished rollouts are kept in the cache; a stopped run
goes on.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import cenic
import numpy as np
import two_steps
from scipy.stats import qmc
from two_steps import Later

from hw.types import Array
from sim.lab.physics import Physics, simulate_of
from sim.tasks import get_task
from sim.tasks.fingerprint import scene_key
from sim.tasks.task import Task

COARSER = 4
STEPS_S = (0.010, 0.005, 0.004)
"""Longer than that of training."""
ACCURACIES, LIMIT = (1e-2, 1e-3), 1e-6
"""Of CENIC, and the one that stands for its limit."""
MESHES_M = {"pushing": 0.025}
"""A coarser mesh, twice the edge; a piece of food has its triangles by design."""
LATER = {"pushing": (Later(0.06, 0.005),), "scooping": (Later(0.3, 0.010), Later(0.4, 0.010))}
"""Longer steps after the impact."""
TURN = 10
"""Draws that one setting runs before the next has its turn."""


@dataclass(frozen=True)
class Setting:
    """One way to compute the same rollout."""

    contact: str
    dt_s: float
    accuracy: float | None = None  # None: fixed steps; else CENIC's
    mesh_m: float | None = None  # None: that of training
    physics: Physics = "drake"
    later: Later | None = None

    def __str__(self) -> str:
        if self.physics != "drake":
            return self.physics
        if self.accuracy:
            return f"CENIC, {self.accuracy:g}"
        mesh = f", mesh {1e3 * self.mesh_m:g} mm" if self.mesh_m else ""
        then = self.later
        after = f", {1e3 * then.step_s:g} ms from {then.delay_s:g} s after the impact on" if then else ""
        return f"{self.contact}, {1e3 * self.dt_s:g} ms{mesh}{after}"

    @property
    def file(self) -> str:
        """Its part of the name in the cache."""
        if self.physics != "drake":
            return self.physics
        mesh = f"-mesh-{1e6 * self.mesh_m:.0f}um" if self.mesh_m else ""
        then = self.later
        after = f"-then-{1e6 * then.step_s:.0f}us-{then.delay_s:g}s" if then else ""
        return f"cenic-{self.accuracy:g}" if self.accuracy else f"{self.contact}-{1e6 * self.dt_s:.0f}us{mesh}{after}"

    def within(self, task: Task) -> AbstractContextManager[object]:
        """Rollouts of this process are computed so, as far as no effect of a world says it."""
        if self.accuracy:
            return cenic.stepping(task, self.accuracy)
        if self.later:
            return two_steps.stepping(task, self.later)
        return patch(f"sim.tasks.{task.name}.scene.MESH_M", self.mesh_m) if self.mesh_m else nullcontext()


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
    limit = replace(chosen, dt_s=chosen.dt_s / COARSER)
    others = _candidates(task, chosen) if arguments.all else []
    delays = LATER.get(task.name, ()) if arguments.all or arguments.later else ()
    candidates = list(dict.fromkeys([chosen, *others, *(replace(chosen, later=then) for then in delays)]))
    own_limit = replace(chosen, accuracy=LIMIT)
    by_cenic = [replace(chosen, accuracy=a) for a in ACCURACIES] if arguments.cenic else []
    settings = list(dict.fromkeys([limit, *candidates, *([*by_cenic, own_limit] if arguments.cenic else ())]))
    rows = measure(task, draws, settings, Path(arguments.cache) / scene_key(task))
    print(f"{task.name}: {arguments.count} rollouts over the ranges, against {limit} (a quarter of training's step)")
    print(
        "setting | outcome agrees | success (limit) | XY apart, mm: median of all times, end median / p90, "
        "end median where both succeed | CPU ms | of training's"
    )
    trained_s = rows[chosen].cpu_s.mean()

    def show(candidate: Setting, against: Setting, name: str) -> None:
        share = rows[candidate].cpu_s.mean() / trained_s
        print(f"{name} | {compare(rows[candidate], rows[against])} | {share:.2f}", flush=True)

    for candidate in [*candidates, limit]:
        show(candidate, limit, f"{candidate}{' <- training' if candidate is chosen else ''}")
    for candidate in by_cenic:
        show(candidate, own_limit, f"{candidate}, against {own_limit}")
        show(candidate, limit, f"{candidate}, against {limit}")
    if arguments.arm:
        alone_s = rows[chosen].cpu_s[: arguments.arm].mean()
        whole_s = whole_arm_cpu_s(task, draws, arguments.arm)
        print(f"with a whole arm: {1e3 * whole_s:.0f} ms, {whole_s / alone_s:.1f} times the rollout of training")


def _candidates(task: Task, chosen: Setting) -> list[Setting]:
    """Cheaper settings than the `chosen` one."""
    other = "lagged" if chosen.contact == "sap" else "sap"
    steps = [Setting(c, dt_s) for c in (chosen.contact, other) for dt_s in (*STEPS_S, chosen.dt_s)]
    mesh_m = MESHES_M.get(task.name)
    meshes = [replace(chosen, mesh_m=mesh_m)] if mesh_m else []
    return [*steps, *meshes, replace(chosen, accuracy=ACCURACIES[0]), replace(chosen, physics="mujoco")]


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
    task: Task, draws: Sequence[tuple[Array, Array, Array]], settings: Sequence[Setting], cache: Path
) -> dict[Setting, Measured]:
    """Every draw with each setting, from the cache as far as it goes."""
    cache.mkdir(parents=True, exist_ok=True)
    files = {setting: cache / f"{task.name}-{setting.file}-ends.jsonl" for setting in settings}
    for first in range(0, len(draws), TURN):
        for setting, file in files.items():
            done = len(file.read_text().splitlines()) if file.exists() else 0
            _add(task, draws[max(done, first) : first + TURN], setting, file)
    return {setting: _measured(task, file, len(draws)) for setting, file in files.items()}


def _add(task: Task, draws: Sequence[tuple[Array, Array, Array]], setting: Setting, file: Path) -> None:
    """Run the draws and add them to a file of the cache."""
    unmodelled = task.unmodelled(contact=setting.contact, dt_s=setting.dt_s)
    simulate = simulate_of(task.name, setting.physics)
    with file.open("a") as out, setting.within(task):
        for parameters, action, nuisance in draws:
            before_s = time.process_time()
            track = simulate(parameters, task.reference_context, action, nuisance, unmodelled)
            cpu_s = time.process_time() - before_s
            row = {
                "outcome": track.outcome.value,
                "succeeded": float(task.succeeded(track)),
                "state": track.at(task.observation.times_s).tolist(),
                "end": track.state[-1].tolist(),
                "cpu_s": cpu_s,
            }
            out.write(json.dumps(row) + "\n")
            out.flush()


def _measured(task: Task, file: Path, count: int) -> Measured:
    rows = [json.loads(line) for line in file.read_text().splitlines()[:count]]
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
    parser.add_argument("--all", action="store_true", help="also every cheaper candidate")
    parser.add_argument("--later", action="store_true", help="also the longer steps after the impact")
    parser.add_argument("--cenic", action="store_true", help="also CENIC against its own limit")
    parser.add_argument("--cache", default="build/convergence")
    return parser.parse_args()


if __name__ == "__main__":
    main()
