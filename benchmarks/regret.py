"""Does adapting matter? The regret matrix: policies trained for one environment, run in all others and in the worlds.

    python benchmarks/regret.py --task scooping --cache build/regret --figure docs/figures/regret-scooping.png
    python benchmarks/regret.py --task pendulum --figure docs/figures/regret-pendulum.png

Where a task has no exact solver: every environment is tried with the same actions (a scrambled Sobol sequence) under
the same executed noise, one rollout each at the task's reference context, scored at `--contexts` contexts. The policy
of E takes, at each context, the action whose reward in E, smoothed over neighbouring actions, is best; the entry (E,
target) is its smoothed reward there, averaged over the contexts; UDR takes the best action for the mean over Omega.
Nothing is learned, so nothing but the scene can be blamed. Outcomes are kept in the cache; a second run only adds what
is missing.

Where a task has one, the policies and their rewards are its own, and the best E is sought in a fine draw from Omega.
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
from sim.adaptation.methods.udr import Udr
from sim.lab.world import shipped_worlds
from sim.rollouts.draws import cover, sobol
from sim.tasks import get_task
from sim.tasks.fingerprint import scene_key
from sim.tasks.task import Task

FINE = 8192
"""Parameters in Omega that the best E is sought among, where that costs nothing."""


@dataclass(frozen=True, eq=False)
class Environment:
    """One target: a point of Omega (nuisance drawn anew each time) or a world of the lab."""

    name: str
    parameters: Array
    nuisance: Array | None
    unmodelled: object


@dataclass(frozen=True, eq=False)
class Matrix:
    """What the policies earn: rows are the environments of Omega and then UDR, columns those and then the worlds."""

    rewards: Array  # (n + 1, n + w)
    best_E: Array  # (w,) of the best parameters in Omega
    any_action: Array  # (w,) of the best action there is


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    omega = omega_environments(task, arguments.environments)
    worlds = world_environments(task)
    matrix = exact(task, omega, worlds) if task.exact else searched(task, omega, worlds, arguments)
    n = len(omega)
    own, udr = np.diag(matrix.rewards[:n, :n]).mean(), matrix.rewards[n, :n].mean()
    print(f"over Omega: {own:.3f} with the true parameters, {udr:.3f} with UDR")
    for j, world in enumerate(worlds):
        print(
            f"{world.name:>16}: UDR {matrix.rewards[n, n + j]:.2f}, best E {matrix.best_E[j]:.2f}, "
            f"any action {matrix.any_action[j]:.2f}"
        )
    if arguments.figure:
        draw(matrix.rewards, [*(e.name for e in omega), *(w.name for w in worlds)], n, Path(arguments.figure))


def exact(task: Task, omega: Sequence[Environment], worlds: Sequence[Environment]) -> Matrix:
    """By the task's own solver."""
    assert task.exact is not None
    solver, rng = task.exact(task), np.random.default_rng(0)
    contexts = task.context.sample(rng, 1)

    def earned(samples: Array, targets: Sequence[Environment]) -> Array:
        """Distributions (B, m, p) -> rewards (B, targets)."""
        actions = np.stack([policy.actions(contexts) for policy in solver.policies(samples, rng)])
        columns = [np.tile(t.parameters, (len(samples), 1)) for t in targets]
        return np.stack([solver.expected_rewards(c, contexts, actions, rng) for c in columns], axis=1)

    everywhere = [*omega, *worlds]
    rows = earned(np.stack([e.parameters for e in omega])[:, None], everywhere)
    udr = earned(Udr(task).start(1, rng)[0].samples[None], everywhere)
    reach = np.clip(1.2 * sobol(FINE, len(task.parameters), rng) - 0.1, 0.0, 1.0 - 1e-9)  # the faces of the box too
    fine = task.parameters.spread(reach)
    own = np.stack([w.parameters for w in worlds])[:, None]
    return Matrix(np.vstack([rows, udr]), earned(fine[:, None], worlds).max(axis=0), np.diag(earned(own, worlds)))


def searched(
    task: Task, omega: Sequence[Environment], worlds: Sequence[Environment], arguments: argparse.Namespace
) -> Matrix:
    """By trying actions in every environment."""
    actions = task.action.denormalise(qmc.Sobol(len(task.action), seed=0).random(arguments.actions))
    contexts = cover(task.context, arguments.contexts, np.random.default_rng(0))
    cache = Path(arguments.cache) / scene_key(task)
    measure = partial(rewards, task.name, actions, contexts, arguments.draws, cache)
    with ProcessPoolExecutor(arguments.workers) as executor:
        table = np.stack(list(executor.map(measure, [*omega, *worlds])), axis=1)  # (actions, environments, contexts)
    smoothed = smooth(task.action.normalise(actions), table, arguments.bandwidth)
    n, g = len(omega), np.arange(len(contexts))
    chosen = smoothed[:, :n].argmax(axis=0)  # (n, contexts)
    udr = smoothed[:, :n].mean(axis=1).argmax(axis=0)  # (contexts,)
    played = np.vstack([chosen, udr])
    matrix = np.stack([smoothed[row, :, g].mean(axis=0) for row in played])
    best = matrix[:n, n:].argmax(axis=0)  # which E serves each world best
    print(f"{len(actions)} actions x {arguments.draws} draws x {n} environments of Omega and {len(worlds)} worlds")
    if arguments.confirm:
        print(f"confirmed with {arguments.confirm} rollouts each:")
        for world, e in zip(worlds, best, strict=True):
            fresh = [confirm(task, world, contexts, actions[row], arguments.confirm) for row in (udr, chosen[e])]
            print(json.dumps({"world": world.name, "udr": round(fresh[0], 3), "best_E": round(fresh[1], 3)}))
    any_action = smoothed[:, n:].max(axis=0).mean(axis=-1)
    return Matrix(matrix, matrix[best, n + np.arange(len(worlds))], any_action)


def confirm(task: Task, world: Environment, contexts: Array, actions: Array, count: int) -> float:
    """Mean reward of a policy (actions (G, a) at contexts (G, c)) in a world, with noise that no table has seen."""
    assert world.nuisance is not None, "the worlds of tables have one"
    rng, earned = np.random.default_rng(1), []
    for k in range(count):
        context, action = contexts[k % len(contexts)], actions[k % len(contexts)]
        executed = action + rng.uniform(-1.0, 1.0, len(action)) * task.action_noise
        track = task.simulate(world.parameters, context, executed, world.nuisance, world.unmodelled)
        earned.append(task.score(track, context))
    return float(np.mean(earned))


def omega_environments(task: Task, count: int) -> list[Environment]:
    """`count` points of Omega; integer parameters go round."""
    space = task.parameters
    parameters = space.denormalise(qmc.Sobol(len(space), seed=1).random(count))
    for i, d in enumerate(space.dimensions):
        if d.scale == "integer":
            parameters[:, i] = d.low + np.arange(count) % (d.high - d.low + 1)
    return [Environment(f"E{i}", p, None, None) for i, p in enumerate(parameters)]


def world_environments(task: Task) -> list[Environment]:
    """Every world that ships with the task."""
    worlds = shipped_worlds(task)
    return [Environment(w.name, w.parameters, w.nuisance, w.unmodelled) for w in worlds]


def rewards(
    task_name: str, actions: Array, contexts: Array, draws: int, cache: Path, environment: Environment
) -> Array:
    """(actions, contexts) mean reward over `draws`; the rollouts from the cache if they have been done before."""
    what = f"{actions.tobytes().hex()} {draws} {environment.parameters} {environment.nuisance}"
    key = hashlib.sha256(f"{what} {environment.unmodelled}".encode()).hexdigest()[:16]
    file = cache / f"{environment.name}-{key}.npz"
    if not file.exists():
        cache.mkdir(parents=True, exist_ok=True)
        succeeded, end_state = _measure(task_name, actions, draws, environment)
        np.savez(file, succeeded=succeeded, end_state=end_state)
    with np.load(file) as stored:
        succeeded, end = stored["succeeded"][:, :, None], stored["end_state"][:, :, None]
    end = np.where(succeeded[..., None], end, 0.0)
    earned = np.where(succeeded, get_task(task_name).reward_of_success(end, contexts), 0.0)
    by_context = np.broadcast_to(earned.mean(axis=1), (len(actions), len(contexts)))  # some rewards are the same at all
    return np.array(by_context)


def _measure(task_name: str, actions: Array, draws: int, environment: Environment) -> tuple[Array, Array]:
    """succeeded (actions, draws) and end states (actions, draws, k) at the reference context.

    The same noise in every environment, so that differences are the environments'.
    """
    task = get_task(task_name)
    rng = np.random.default_rng(0)
    noise = rng.uniform(-1.0, 1.0, (len(actions), draws, len(task.action))) * task.action_noise
    nuisance = task.nuisance.denormalise(rng.random((len(actions), draws, len(task.nuisance))))
    succeeded, ends = np.zeros((len(actions), draws), dtype=bool), []
    for i, k in np.ndindex(*succeeded.shape):
        drawn = nuisance[i, k] if environment.nuisance is None else environment.nuisance
        track = task.simulate(
            environment.parameters, task.reference_context, actions[i] + noise[i, k], drawn, environment.unmodelled
        )
        succeeded[i, k] = task.succeeded(track)
        ends.append(np.atleast_1d(task.end_state(track)))
    return succeeded, np.stack(ends).reshape(*succeeded.shape, -1)


def smooth(unit_actions: Array, table: Array, bandwidth: float) -> Array:
    """(actions, ...) averaged over neighbouring actions."""
    squared = ((unit_actions[:, None] - unit_actions) ** 2).sum(axis=-1)
    weights = np.exp(-squared / (2.0 * bandwidth**2))
    return np.tensordot(weights / weights.sum(axis=1, keepdims=True), table, axes=1)


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
    axes.set_xlabel("run in (left: within Omega, right: worlds)")
    axes.set_ylabel("policy trained for")
    figure.colorbar(image, label="expected reward")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--actions", type=int, default=64)
    parser.add_argument("--draws", type=int, default=2)
    parser.add_argument("--contexts", type=int, default=16, help="at which every rollout is scored")
    parser.add_argument("--bandwidth", type=float, default=0.20, help="of the smoothing, as a share of each range")
    parser.add_argument("--environments", type=int, default=24)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--confirm", type=int, default=0, help="rollouts to confirm each world's two numbers with")
    parser.add_argument("--cache", default="build/regret")
    parser.add_argument("--figure", default="")
    return parser.parse_args()


if __name__ == "__main__":
    main()
