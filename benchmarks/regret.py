"""Does adapting matter? The regret matrix: policies trained for one environment, run in all others and in the worlds.

    python benchmarks/regret.py --task scooping --cache build/regret --figure docs/figures/regret-scooping.png

Every environment is tried with the same actions (a scrambled Sobol sequence) under the same executed noise, one Drake
rollout each. The policy of E is the action whose reward in E, smoothed over neighbouring actions, is best; the
entry (E, target) is its smoothed reward there; UDR is the best action for the mean over Omega. Nothing is
learned, so nothing but the scene can be blamed. Rollouts are kept in the cache; a second run only adds what is missing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.stats import qmc

from hw.types import Array
from sim.tasks import get_task
from sim.tasks.scene_key import scene_key
from sim.world import list_worlds, load_world

BANDWIDTH = 0.20
"""Of the Gaussian weights over neighbouring actions, as a share of each range."""


@dataclass(frozen=True, eq=False)
class Environment:
    """One target: a point of Omega (nuisance drawn anew each time) or a world of the lab."""

    name: str
    parameters: Array
    nuisance: Array | None
    unmodelled: object


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    omega = omega_environments(arguments.task, arguments.environments)
    worlds = world_environments(arguments.task)
    actions = task.action.denormalise(qmc.Sobol(len(task.action), seed=0).random(arguments.actions))
    cache = Path(arguments.cache) / scene_key(task)
    measure = partial(rewards, arguments.task, actions, arguments.draws, cache)
    with ProcessPoolExecutor(arguments.workers) as executor:
        table = np.stack(list(executor.map(measure, [*omega, *worlds])), axis=1)  # (actions, environments)
    smoothed = smooth(task.action.normalise(actions), table)
    n = len(omega)
    chosen = smoothed[:, :n].argmax(axis=0)
    udr = int(smoothed[:, :n].mean(axis=1).argmax())
    best = smoothed[chosen].argmax(axis=0)  # which E serves each target best
    print(f"{arguments.actions} actions x {arguments.draws} draws x {n} environments of Omega and {len(worlds)} worlds")
    print(f"UDR's action: {dict(zip(task.action.names, actions[udr].round(3).tolist(), strict=True))}")
    own = smoothed[chosen, np.arange(n)].mean()
    print(f"over Omega: {own:.3f} with the true parameters, {smoothed[udr, :n].mean():.3f} with UDR")
    rows = []
    for j, world in enumerate(worlds, start=n):
        row = {"world": world.name, "udr": smoothed[udr, j], "best_E": smoothed[chosen[best[j]], j]}
        row["any_action"] = smoothed[:, j].max()
        rows.append({**row, "action": actions[chosen[best[j]]].round(3).tolist()})
        print(f"{world.name:>16}: UDR {row['udr']:.2f}, best E {row['best_E']:.2f}, any action {row['any_action']:.2f}")
    if arguments.confirm:
        confirm(arguments, worlds, rows, actions[udr])
    if arguments.figure:
        names = [*(e.name for e in omega), *(w.name for w in worlds)]
        draw(np.vstack([smoothed[chosen], smoothed[udr]]), names, n, Path(arguments.figure))


def confirm(arguments: argparse.Namespace, worlds: Sequence[Environment], rows: Sequence[dict], udr: Array) -> None:
    """Run UDR's and the best E's action anew in every world, with executed noise that the table has not seen."""
    print(f"confirmed with {arguments.confirm} rollouts each:")
    for world, row in zip(worlds, rows, strict=True):
        pair = np.stack([udr, np.array(row["action"])])
        fresh = _measure(arguments.task, pair, arguments.confirm, world, seed=1)
        print(json.dumps({"world": world.name, "udr": round(fresh[0], 3), "best_E": round(fresh[1], 3)}))


def omega_environments(task_name: str, count: int) -> list[Environment]:
    """`count` points of Omega; integer parameters go round."""
    space = get_task(task_name).parameters
    parameters = space.denormalise(qmc.Sobol(len(space), seed=1).random(count))
    for i, d in enumerate(space.dimensions):
        if d.scale == "integer":
            parameters[:, i] = d.low + np.arange(count) % (d.high - d.low + 1)
    return [Environment(f"E{i}", p, None, None) for i, p in enumerate(parameters)]


def world_environments(task_name: str) -> list[Environment]:
    """Every world that ships with the task."""
    task = get_task(task_name)
    worlds = [load_world(name, task) for name in list_worlds(task)]
    return [Environment(w.name, w.parameters, w.nuisance, w.unmodelled) for w in worlds]


def rewards(task_name: str, actions: Array, draws: int, cache: Path, environment: Environment) -> Array:
    """(actions,) mean reward over `draws`, from the cache if it has been measured before."""
    what = f"{actions.tobytes().hex()} {draws} {environment.parameters} {environment.nuisance}"
    key = hashlib.sha256(f"{what} {environment.unmodelled}".encode()).hexdigest()[:16]
    file = cache / f"{environment.name}-{key}.npy"
    if not file.exists():
        cache.mkdir(parents=True, exist_ok=True)
        np.save(file, _measure(task_name, actions, draws, environment, seed=0))
    measured: Array = np.load(file)
    return measured


def _measure(task_name: str, actions: Array, draws: int, environment: Environment, seed: int) -> Array:
    """(actions,) mean reward; the same noise in every environment, so that differences are the environments'."""
    task = get_task(task_name)
    rng = np.random.default_rng(seed)
    noise = rng.uniform(-1.0, 1.0, (len(actions), draws, len(task.action))) * task.action_noise
    nuisance = task.nuisance.denormalise(rng.random((len(actions), draws, len(task.nuisance))))
    context = task.reference_context
    table = np.zeros((len(actions), draws))
    for i, k in np.ndindex(*table.shape):
        drawn = nuisance[i, k] if environment.nuisance is None else environment.nuisance
        executed = actions[i] + noise[i, k]
        track = task.simulate(environment.parameters, context, executed, drawn, environment.unmodelled)
        table[i, k] = task.score(track, context)
    return table.mean(axis=1)


def smooth(unit_actions: Array, table: Array) -> Array:
    """(actions, ...) averaged over neighbouring actions."""
    squared = ((unit_actions[:, None] - unit_actions) ** 2).sum(axis=-1)
    weights = np.exp(-squared / (2.0 * BANDWIDTH**2))
    return weights / weights.sum(axis=1, keepdims=True) @ table


def draw(matrix: Array, names: Sequence[str], count: int, file: Path) -> None:
    """The matrix as a picture: rows E and UDR, columns environments and worlds."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415 - after the backend is chosen

    figure, axes = plt.subplots(figsize=(0.32 * len(names) + 2.5, 0.28 * len(matrix) + 2.0), layout="constrained")
    image = axes.imshow(matrix, vmin=0.0, vmax=1.0, cmap="viridis", aspect="auto")
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_yticks(range(len(matrix)), [*names[:count], "UDR"], fontsize=7)
    axes.axvline(count - 0.5, color="white", linewidth=2)
    axes.axhline(count - 0.5, color="white", linewidth=2)
    axes.set_xlabel("run in (left: within Omega, right: worlds of the lab)")
    axes.set_ylabel("policy trained for")
    figure.colorbar(image, label="expected reward")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--actions", type=int, default=64)
    parser.add_argument("--draws", type=int, default=2)
    parser.add_argument("--environments", type=int, default=24)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--confirm", type=int, default=0, help="rollouts to confirm each world's two numbers with")
    parser.add_argument("--cache", default="build/regret")
    parser.add_argument("--figure", default="")
    return parser.parse_args()


if __name__ == "__main__":
    main()
