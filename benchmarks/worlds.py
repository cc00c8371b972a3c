"""What a session gains: methods in the lab's worlds, judged by true Drake rollouts.

    python benchmarks/worlds.py --task scooping --seeds 3

Sessions see what an operator's would (two trials for each of two particles, five iterations, noisy observations), but
the tool is driven directly in the world's physics, without arm and camera, so that many fit into minutes. The final
policy of each session is run `--rollouts` times in the world, under the executed-action error of training. The oracle
is the best of the policies trained for a space-filling set of E in Omega: chosen by rollouts in the world in two
rounds, judged on fresh ones. The more E it tries (`--candidates`), the nearer it comes to the best E.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept import Kept

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.methods import make_method
from sim.adaptation.methods.udr import udr_policies
from sim.lab.world import World, load_world, rollouts_in, shipped_worlds
from sim.research.pretraining.evaluation import LEAST_GAP, EvaluationSettings, run_session
from sim.rollouts import process_pool, run_many
from sim.rollouts.draws import cover, trial_requests
from sim.rollouts.run import Roll
from sim.solvers.solver import SolvedPolicy
from sim.tasks import get_task
from sim.tasks.task import Task

SCREENING, FINAL, AGAIN = 8, 4, 32
"""Rollouts by which the oracle leaves `FINAL` of its policies, and by which it then chooses."""

UDR_DRAWS = 8
"""Policies behind what UDR earns: in one world they differ as much as success and failure."""


@dataclass(frozen=True)
class Row:
    """The final policy of one session, as `adaptsim benchmark` reports it."""

    task: str
    target: str
    method: str
    seed: int
    reward: float
    ci95: Sequence[float]
    real_trials: int
    wall_s: float


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    checkpoint = load_checkpoint(task, arguments.checkpoint)
    names = arguments.worlds or [world.name for world in shipped_worlds(task)]
    rows, kept = list[Row](), Kept(Path(arguments.keep) if arguments.keep else None)
    with process_pool(arguments.workers) as executor:
        for name in names:
            for method, seed, make in in_world(task, load_world(name, task), checkpoint, executor, arguments):
                found = kept.row(f"{name} {method}", seed, make)
                print(json.dumps(found), flush=True)
                rows.append(Row(**found))
    print(table(rows))


def in_world(
    task: Task, world: World, checkpoint: Checkpoint, executor: Executor, arguments: argparse.Namespace
) -> Iterable[tuple[str, int, Callable[[], dict[str, Any]]]]:
    """(method, seed, what makes its row), for each that was asked for."""
    there = replace(task, simulate=rollouts_in(world))

    def roll(requests: Any) -> Any:
        return run_many(there, requests, executor)

    settings = EvaluationSettings()
    solver, n = checkpoint.solver, arguments.rollouts

    def row(method: str, seed: int, policy: SolvedPolicy, trials: int, since: float) -> dict[str, Any]:
        return told(method, seed, rewards_of(task, policy, roll, n, np.random.default_rng((seed, 1))), trials, since)

    def told(method: str, seed: int, rewards: Array, trials: int, since: float) -> dict[str, Any]:
        half = 1.96 * float(rewards.std(ddof=1)) / len(rewards) ** 0.5
        mean = float(rewards.mean())
        ci95 = (round(mean - half, 3), round(mean + half, 3))
        return asdict(
            Row(task.name, world.name, method, seed, round(mean, 3), ci95, trials, round(time.time() - since))
        )

    def udr() -> dict[str, Any]:
        began, draws = time.time(), udr_policies(solver, np.random.default_rng(0), UDR_DRAWS)
        means = [rewards_of(task, p, roll, n // 4, np.random.default_rng(1)).mean() for p in draws]
        return told("udr", 0, np.array(means), 0, began)

    def oracle() -> dict[str, Any]:
        began, rng = time.time(), np.random.default_rng(3)
        grid = cover(task.parameters, arguments.candidates, rng)
        policies = solver.policies(grid[:, None, :], rng)
        screened = [rewards_of(task, p, roll, SCREENING, np.random.default_rng(2)).mean() for p in policies]
        left = [policies[i] for i in np.argsort(screened)[-FINAL:]]
        again = [rewards_of(task, p, roll, AGAIN, np.random.default_rng(3)).mean() for p in left]
        trials = arguments.candidates * SCREENING + len(left) * AGAIN
        return row("oracle", 0, left[int(np.argmax(again))], trials, began)

    def session(method: str, seed: int) -> dict[str, Any]:
        began, rng = time.time(), np.random.default_rng((seed, 0))
        found = run_session(solver, make_method(method, task, checkpoint), world.parameters, roll, settings, rng)
        trials = settings.particles * settings.iterations * task.adaptation.trials_per_iteration
        return row(method, seed, found.choice(settings.iterations), trials, began)

    yield "udr", 0, udr
    yield "oracle", 0, oracle
    for method in arguments.methods:
        for seed in range(arguments.seeds):
            yield method, seed, partial(session, method, seed)


def rewards_of(task: Task, policy: SolvedPolicy, roll: Roll, n: int, rng: np.random.Generator) -> Array:
    """(n,) true rewards over contexts and executed-action errors."""
    contexts = task.context.sample(rng, n)
    nowhere = np.zeros((n, len(task.parameters)))  # the world has its own
    return roll(trial_requests(task, nowhere, contexts, policy.actions(contexts), rng)).rewards(task, contexts)


def table(rows: Sequence[Row]) -> str:
    """Rewards by world and method (mean over seeds), and the share of the gap that each method closes."""
    methods = list(dict.fromkeys(r.method for r in rows))
    worlds = list(dict.fromkeys(r.target for r in rows))
    mean = np.array(
        [[np.mean([r.reward for r in rows if (r.target, r.method) == (w, m)]) for m in methods] for w in worlds]
    )
    lines = ["| world | " + " | ".join(methods) + " |", "|---" * (len(methods) + 1) + "|"]
    for world, values in zip(worlds, mean, strict=True):
        lines.append(f"| {world} | " + " | ".join(f"{v:.2f}" for v in values) + " |")
    udr, oracle = mean[:, methods.index("udr")], mean[:, methods.index("oracle")]
    gap = oracle - udr >= LEAST_GAP
    lines.append(f"\n{gap.sum()} of {len(worlds)} worlds have a gap of at least {LEAST_GAP:g} between udr and oracle.")
    for i, method in enumerate(methods):
        if method in ("udr", "oracle") or not gap.any():
            continue
        gain, room = (mean[:, i] - udr)[gap], (oracle - udr)[gap]
        drawn = np.random.default_rng(0).integers(gap.sum(), size=(2000, gap.sum()))
        low, high = np.quantile(gain[drawn].sum(axis=1) / room[drawn].sum(axis=1), [0.025, 0.975])
        share = gain.sum() / room.sum()
        lines.append(f"{method} closes {share:.2f} of it (95 % {low:.2f} to {high:.2f}, bootstrap over worlds).")
    return "\n".join(lines)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Methods in the lab's worlds, judged by true rollouts")
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--checkpoint", default="default", help="name of a shipped checkpoint, or a folder")
    parser.add_argument("--worlds", nargs="*", help="default: all that ship with the task")
    parser.add_argument("--methods", nargs="*", default=["adaptsim-belief", "adaptsim-iteration", "random"])
    parser.add_argument("--candidates", type=int, default=16, help="E that the oracle chooses from")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--rollouts", type=int, default=40, help="behind each reward")
    parser.add_argument("--keep", help="file that keeps the rows, so that a second run makes only what is missing")
    parser.add_argument("--workers", type=int, default=None)
    return parser.parse_args()


if __name__ == "__main__":
    main()
