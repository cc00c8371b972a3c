"""Is every action of a task within the arm's limits? Worst ratio over a grid of contexts and actions.

    python benchmarks/executability.py --task scooping --model panda --model fr3 --png executability.png

The ratio of a motion is the largest of any joint's position, velocity, acceleration and jerk to its limit. A motion is
executable when approach, task and retreat pass every check of `hw.limits`, a stop along the path is possible at any
moment, and no ratio of the task path is above `sim.panda.redundancy.ALLOWED`. `--noise` widens the grid by the task's
action noise.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from hw.limits import check_braking, check_path
from hw.types import Array
from sim.errors import NotExecutable
from sim.panda.planning import home, trial_paths
from sim.panda.redundancy import ALLOWED
from sim.tasks import get_task
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class Motion:
    """One point of the grid. `ratio` is infinite where there is no path; `note` says why, or what is tightest."""

    context: Array
    action: Array
    ratio: float
    cpu_s: float
    note: str


def grid(low: Array, high: Array, points: int) -> list[Array]:
    """`points` per dimension, ends included."""
    return [np.array(v) for v in product(*(np.linspace(a, b, points) for a, b in zip(low, high, strict=True)))]


def examine(task: Task, model: str, contexts: list[Array], actions: list[Array]) -> list[Motion]:
    """Plan every trial of the grid, approach and retreat included."""
    if task.plan is None:
        raise SystemExit(f"{task.name} has no motion for an arm")
    q_home = home(task.X_FT, model)
    found = []
    for context, action in product(contexts, actions):
        motion = task.plan(context, action)
        start = time.process_time()
        try:
            path = trial_paths(motion, task.X_FT, model, q_home)[1]
        except NotExecutable as error:
            found.append(Motion(context, action, np.inf, time.process_time() - start, str(error)))
            continue
        cpu_s = time.process_time() - start
        report = check_path(path, model)
        stops = check_braking(path, model)
        if not stops.ok:
            found.append(Motion(context, action, np.inf, cpu_s, "no stop along the path"))
            continue
        tightest = max((c for c in report.checks if c.unit.startswith("rad")), key=lambda c: c.ratio)
        found.append(Motion(context, action, report.joint_ratio, cpu_s, str(tightest)))
    return found


def show(task: Task, model: str, found: list[Motion]) -> None:
    ratios = np.array([m.ratio for m in found])
    cpu_s = np.array([m.cpu_s for m in found])
    good = ratios <= ALLOWED
    print(f"{model}: {good.sum()} of {len(found)} motions executable (every ratio <= {ALLOWED:g})")
    if good.any():
        quantiles = np.quantile(ratios[good], [0.5, 0.9, 1.0])
        print(f"  ratio of those: median {quantiles[0]:.3f}, 90 % {quantiles[1]:.3f}, worst {quantiles[2]:.3f}")
    print(f"  planning a trial on one core: median {np.median(cpu_s):.2f} s, longest {cpu_s.max():.2f} s")
    for motion in sorted(found, key=lambda m: -m.ratio)[:5]:
        where = ", ".join(
            f"{d.name} {v:.3g}"
            for d, v in zip(
                task.context.dimensions + task.action.dimensions, [*motion.context, *motion.action], strict=True
            )
        )
        print(f"  {motion.ratio:.3f} at {where}: {motion.note}")


def draw(task: Task, results: dict[str, list[Motion]], png: Path) -> None:
    """For every context (its first two dimensions): the share of executable actions, and the worst ratio of these."""
    import matplotlib  # noqa: PLC0415

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(1, len(results), figsize=(4.6 * len(results), 3.8), squeeze=False, layout="constrained")
    names = [d.label for d in task.context.dimensions[:2]]
    for axis, (model, found) in zip(axes[0], results.items(), strict=True):
        xs, ys = (sorted({float(m.context[k]) for m in found}) for k in (0, 1))
        share = np.zeros((len(ys), len(xs)))
        for (i, j), _ in np.ndenumerate(share):
            here = [m.ratio for m in found if (float(m.context[0]), float(m.context[1])) == (xs[j], ys[i])]
            good = [ratio for ratio in here if ratio <= ALLOWED]
            share[i, j] = len(good) / len(here)
            text = f"{len(good)} of {len(here)}" + (f"\nworst {max(good):.2f}" if good else "")
            axis.text(xs[j], ys[i], text, ha="center", va="center")
        image = axis.pcolormesh(xs, ys, share, vmin=0.0, vmax=1.0, cmap="RdYlGn", shading="nearest")
        axis.set(xlabel=names[0], ylabel=names[1], title=f"{task.name}, {model}")
        figure.colorbar(image, ax=axis, label=f"share of actions with every ratio ≤ {ALLOWED:g}")
    figure.savefig(png, dpi=150)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--model", action="append", choices=["panda", "fr3"])
    parser.add_argument("--contexts", type=int, default=3, help="grid points per context dimension")
    parser.add_argument("--actions", type=int, default=2, help="grid points per action dimension")
    parser.add_argument("--noise", action="store_true", help="widen the actions by the task's action noise")
    parser.add_argument("--png", type=Path)
    options = parser.parse_args()
    chosen = get_task(options.task)
    contexts = grid(chosen.context.low, chosen.context.high, options.contexts)
    noise = chosen.action_noise if options.noise else np.zeros(len(chosen.action))
    actions = grid(chosen.action.low - noise, chosen.action.high + noise, options.actions)
    results = {}
    for model in options.model or ["panda", "fr3"]:
        results[model] = examine(chosen, model, contexts, actions)
        show(chosen, model, results[model])
    if options.png:
        draw(chosen, results, options.png)
        print(f"picture: {options.png}")


if __name__ == "__main__":
    main()
