"""Is every action of a task within the arm's limits? Worst ratio over a grid of contexts and actions.

    python benchmarks/executability.py --contexts 2 --actions 2
    python benchmarks/executability.py --task pushing --contexts 1 --actions 9 5 --png executability.png
    python benchmarks/executability.py --draws 40 --side left

The ratio of a motion is the largest of any joint's position, velocity, acceleration and jerk to its limit. A motion is
executable when approach, task and retreat pass every check of `hw.limits`, a stop along the path is possible at any
moment, and no ratio of the task path is above `sim.panda.redundancy.ALLOWED`. `--side` adds the boxes that a rig has by
itself: the simulated lab's camera, and a person on that side. `--draws` draws trials instead of the grid. The picture
maps the first two dimensions of the actions.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import get_args

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

from adaptsim_cli.bench.rig_file.description import PersonPart
from hw.braking import check_braking
from hw.collision import KeepOut, Side, camera_box
from hw.kinematics import forward
from hw.limits import JOINT_QUANTITIES
from hw.types import Array
from sim.errors import NotExecutable
from sim.lab.kinect import default_X_BC
from sim.panda.planning import home, trial_paths
from sim.panda.redundancy import ALLOWED
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task
from sim.tasks.task import Task

GENTLE_LEAN_RAD = 0.01
STOPS_EVERY_S = 0.01


@dataclass(frozen=True, eq=False)
class Motion:
    """One point of the grid. `ratio` is infinite where there is no path; `note` gives the reason, or the limit that is
    used most.
    """

    context: Array
    action: Array
    ratio: float
    cpu_s: float
    note: str
    tightest: str = ""  # "joint 4, velocity"
    home_lean_rad: float = 0.0  # the largest change of the tool's roll on the way home
    stops_s: tuple[float, ...] = ()  # durations of stops along the task path


def grid(low: Array, high: Array, points: list[int]) -> list[Array]:
    """A grid of `points` per dimension (one number: the same for all), ends included; a single point is the middle."""
    counts = points * len(low) if len(points) == 1 else points
    lines = (np.linspace(a, b, n) if n > 1 else [(a + b) / 2] for a, b, n in zip(low, high, counts, strict=True))
    return [np.array(v) for v in product(*lines)]


def drawn(task: Task, count: int, seed: int) -> list[tuple[Array, Array]]:
    """This many uniform contexts and actions."""
    rng = np.random.default_rng(seed)
    spaces = (task.context, task.action)
    trials = [[space.denormalise(rng.random(len(space.low))) for space in spaces] for _ in range(count)]
    return [(context, action) for context, action in trials]


def examine(
    task: Task, model: str, trials: list[tuple[Array, Array]], keep_out: tuple[KeepOut, ...] = ()
) -> list[Motion]:
    """Plan every trial (context, action), approach and retreat included."""
    hardware = task.require_hardware()
    cell = replace(cell_as_shipped(hardware, model), keep_out=keep_out)
    q_home = home(hardware.X_FT, cell)
    motions = []
    for context, action in trials:
        motion = hardware.plan(context, action)
        start = time.process_time()
        try:
            _, path, back = trial_paths(motion, hardware.X_FT, cell, q_home, carries=hardware.carries)
        except NotExecutable as error:
            motions.append(Motion(context, action, np.inf, time.process_time() - start, str(error)))
            continue
        cpu_s = time.process_time() - start
        report = cell.check(path)
        stops = check_braking(path, cell.motion, STOPS_EVERY_S)
        if not stops.ok:
            motions.append(Motion(context, action, np.inf, cpu_s, "no stop along the path"))
            continue
        tightest = max((c for c in report.checks if c.quantity in JOINT_QUANTITIES), key=lambda c: c.ratio)
        what = f"{tightest.where}, {tightest.quantity}"
        lean_rad = np.arcsin((forward(back.q_rad) @ hardware.X_FT)[:, 2, 1])
        motions.append(
            Motion(
                context,
                action,
                report.joint_ratio,
                cpu_s,
                str(tightest),
                what,
                float(np.ptp(lean_rad)),
                tuple(stops.duration_s),
            )
        )
    return motions


def show(task: Task, model: str, motions: list[Motion]) -> None:
    ratios = np.array([m.ratio for m in motions])
    cpu_s = np.array([m.cpu_s for m in motions])
    good = ratios <= ALLOWED
    print(f"{model}: {good.sum()} of {len(motions)} motions executable (every ratio <= {ALLOWED:g})")
    if good.any():
        quantiles = np.quantile(ratios[good], [0.5, 0.9, 1.0])
        print(f"  ratio of those: median {quantiles[0]:.3f}, 90 % {quantiles[1]:.3f}, worst {quantiles[2]:.3f}")
        stops_s = np.concatenate([m.stops_s for m in motions if m.ratio <= ALLOWED])
        half, most, longest = np.quantile(stops_s, [0.5, 0.99, 1.0])
        print(f"  {len(stops_s)} stops of those: median {half:.3f} s, 99 % {most:.3f} s, longest {longest:.3f} s")
    if task.require_hardware().carries and good.any():
        gentle = sum(m.home_lean_rad < GENTLE_LEAN_RAD for m in motions if m.ratio <= ALLOWED)
        print(f"  the tool stays level across on the way home of {gentle} of them")
    print(f"  planning a trial on one core: median {np.median(cpu_s):.2f} s, longest {cpu_s.max():.2f} s")
    for motion in sorted(motions, key=lambda m: -m.ratio)[:5]:
        where = ", ".join(
            f"{d.name} {v:.3g}"
            for d, v in zip(
                task.context.dimensions + task.action.dimensions, [*motion.context, *motion.action], strict=True
            )
        )
        print(f"  {motion.ratio:.3f} at {where}: {motion.note}")


def draw(task: Task, results: dict[str, list[Motion]], png: Path) -> None:
    """A map for each arm over two dimensions of the actions: the worst ratio at each place, and what limits it.

    If not every motion is executable, the worst of those that are, and their number.
    """
    names = [d.label for d in task.action.dimensions[:2]]
    size = (max(5.2, 0.25 + 0.95 * len({m.action[0] for m in next(iter(results.values()))})), 4.2 * len(results))
    figure, axes = plt.subplots(len(results), 1, figsize=size, squeeze=False, layout="constrained")
    light = plt.get_cmap("YlOrBr")(np.linspace(0.05, 0.6, 64))  # black text stays readable
    colours = ListedColormap(light).with_extremes(bad="0.35")
    for axis, (model, motions) in zip(axes[:, 0], results.items(), strict=True):
        places: dict[tuple[float, float], list[Motion]] = {}
        for motion in motions:
            places.setdefault((float(motion.action[0]), float(motion.action[1])), []).append(motion)
        xs, ys = (sorted({place[k] for place in places}) for k in (0, 1))
        worst = np.full((len(ys), len(xs)), np.nan)
        for (x, y), here in places.items():
            good = [m for m in here if m.ratio <= ALLOWED]
            tightest = max(good, key=lambda m: m.ratio, default=None)
            lines = [] if tightest is None else [f"{tightest.ratio:.2f}", *tightest.tightest.split(", ")]
            lines += [f"{len(good)} of {len(here)}"] if len(good) < len(here) or len(here) > 1 else []
            axis.text(x, y, "\n".join(lines), ha="center", va="center", fontsize=8)
            if tightest is not None:
                worst[ys.index(y), xs.index(x)] = tightest.ratio
        image = axis.pcolormesh(
            xs, ys, worst, vmin=0.5, vmax=ALLOWED, cmap=colours, shading="nearest", edgecolors="white"
        )
        share = sum(m.ratio <= ALLOWED for m in motions)
        axis.set(xlabel=names[0], ylabel=names[1], title=f"{task.name}, {model}: {share} of {len(motions)} executable")
        axis.set(xticks=xs, yticks=ys)
        axis.tick_params(labelsize=9)
    label = f"largest ratio of any joint to its limit (allowed: {ALLOWED:g})"
    figure.colorbar(image, ax=axes[:, 0].tolist(), label=label)
    figure.savefig(png, dpi=150)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--contexts", type=int, nargs="+", default=[3], help="grid points, of all or each dimension")
    parser.add_argument("--actions", type=int, nargs="+", default=[2], help="grid points, of all or each dimension")
    parser.add_argument("--draws", type=int, help="trials drawn at random instead of the grid")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--side", choices=get_args(Side), help="with the boxes of a rig whose person stands there")
    parser.add_argument("--png", type=Path)
    options = parser.parse_args()
    chosen = get_task(options.task)
    contexts = grid(chosen.context.low, chosen.context.high, options.contexts)
    actions = grid(chosen.action.low, chosen.action.high, options.actions)
    trials = list(product(contexts, actions))
    if options.draws:
        trials = drawn(chosen, options.draws, options.seed)
    boxes = (camera_box(default_X_BC()), PersonPart(options.side).box()) if options.side else ()
    results = {}
    for model in ("panda", "fr3"):
        results[model] = examine(chosen, model, trials, boxes)
        show(chosen, model, results[model])
    if options.png:
        draw(chosen, results, options.png)
        print(f"picture: {options.png}")


if __name__ == "__main__":
    main()
