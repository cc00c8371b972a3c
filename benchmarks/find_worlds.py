"""Worlds in which adapting pays: an honest search, with the policies that sessions really use.

    python benchmarks/find_worlds.py --task scooping --draws 200 --out build/worlds

Draws parameters and unmodelled effects, and keeps the combinations where UDR's policy fails and the policy of some E in
Omega does not: one of 16 that fill Omega, or the nearest to the world's own. The policies are the checkpoint's. Each
stage uses fresh rollouts over contexts and executed noise, so that what passes by luck is found out: one for each of
several policies of UDR, a few for every E, then `--confirm` for UDR and the best E alone. Every draw is written down,
kept or not; what was kept is also written as a world file.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from worlds import UDR_DRAWS, rewards_of

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.methods.udr import udr_policies
from sim.lab.drawn import as_toml, draw_world, effects_of
from sim.lab.world import World, load_world, rollouts_in
from sim.rollouts import process_pool, run_many
from sim.rollouts.draws import cover
from sim.solvers.solver import SolvedPolicy
from sim.tasks import get_task
from sim.tasks.task import Task

UDR_BELOW, BEST_ABOVE = 0.6, 0.85
CANDIDATES = 16
SCREEN_UDR, SCREEN_EACH = 1, 4


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    solver = load_checkpoint(task, arguments.checkpoint).solver
    rng = np.random.default_rng(0)
    udr = udr_policies(solver, rng, UDR_DRAWS)
    grid = cover(task.parameters, CANDIDATES, rng)
    policies = solver.policies(grid[:, None, :], rng)
    out = Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    with process_pool(arguments.workers) as executor, (out / f"{task.name}.jsonl").open("a") as log:
        for i in range(arguments.first, arguments.first + arguments.draws):
            rng = np.random.default_rng((arguments.seed, i))
            drawn = draw_world(task, rng, within=dict(arguments.within), effects=arguments.effects)
            file = out / f"{task.name}-{i}.toml"
            file.write_text(as_toml(task, drawn), encoding="utf-8")
            nearest = np.clip(drawn.parameters, task.parameters.low, task.parameters.high)
            candidates = (*policies, *solver.policies(nearest[None, None, :], np.random.default_rng(1)))
            row = judge(task, load_world(str(file), task), udr, candidates, executor, arguments.confirm)
            line = json.dumps(
                {"draw": i, **row, "parameters": drawn.parameters.tolist(), "effects": effects_of(task, drawn)}
            )
            log.write(line + "\n")
            log.flush()
            if row["kept"]:
                print(line, flush=True)
            else:
                file.unlink()


def judge(
    task: Task,
    world: World,
    udr: tuple[SolvedPolicy, ...],
    policies: tuple[SolvedPolicy, ...],
    executor: Executor,
    confirm: int,
) -> dict[str, Any]:
    """What UDR and the best E earn there, as far as it had to be looked at."""
    there = replace(task, simulate=rollouts_in(world))

    def mean(policy: SolvedPolicy, n: int, seed: int) -> float:
        def roll(requests: Any) -> Any:
            return run_many(there, requests, executor)

        return round(float(rewards_of(task, policy, roll, n, np.random.default_rng(seed)).mean()), 3)

    def of_udr(n: int, seed: int) -> float:
        return round(float(np.mean([mean(policy, n, seed) for policy in udr])), 3)

    screened = of_udr(SCREEN_UDR, 2)
    if screened > UDR_BELOW:
        return {"kept": False, "udr": screened}
    each = [mean(policy, SCREEN_EACH, 3) for policy in policies]
    best = int(np.argmax(each))
    if each[best] < UDR_BELOW:
        return {"kept": False, "udr": screened, "best": each[best]}
    low, high = of_udr(max(1, confirm // 4), 4), mean(policies[best], confirm, 4)
    near = sum(value >= BEST_ABOVE for value in each)
    return {"kept": low < UDR_BELOW and high > BEST_ABOVE, "udr": low, "best": high, "good": near}


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    name, _, numbers = text.partition("=")
    low, high = map(float, numbers.split(":"))
    return name, (low, high)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--checkpoint", default="default", help="name of a shipped checkpoint, or a folder")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--within", type=_bounds, nargs="*", default=[], help="NAME=LOW:HIGH, where to look")
    parser.add_argument("--effects", nargs="*", default=None, help="only these effects; default: all")
    parser.add_argument("--confirm", type=int, default=20, help="fresh rollouts behind each number of a kept world")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--out", default="build/worlds")
    return parser.parse_args()


if __name__ == "__main__":
    main()
