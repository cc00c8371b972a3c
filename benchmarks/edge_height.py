"""How deep a scoop should aim: reward over the height of the edge, and its mean where that height is uncertain.

In each world one policy is chosen by rollouts with the edge at its planned height: the best of `CANDIDATES` task
policies. Then the same draws (place, action and its error) are scooped with the edge at other heights, the tool driven
directly. Every aim is judged with errors of a touch-off drawn from a normal distribution, interpolated between the
heights of each draw; intervals are paired over draws.

    python benchmarks/edge_height.py --draws 24 --seed 0
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.lab.world import World, load_world
from sim.rollouts.draws import Disturbances, cover
from sim.tasks import get_task
from sim.tasks.scooping import rollout
from sim.tasks.scooping.plan import plan
from sim.types import ToolMotion

TASK = get_task("scooping")
WORLDS = ("wd", "raisin", "oreo", "cucumber")
HEIGHTS_MM = (-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
AIMS_MM = (0.0, -0.25, -0.5, -0.75, -1.0)
SPREADS_MM = (0.05, 0.25, 0.35)
"""Standard deviations of the edge's height: the automatic touch-off in the lab, and guided ones."""
CANDIDATES, SCREENED = 6, 4
"""Task policies to choose from, and rollouts for each."""
ERRORS = 400
"""Errors of a touch-off that every draw is judged with."""


def scooped(world: World, height_m: float, context: Array, action: Array) -> float:
    """The reward of one scoop with the edge `height_m` over its planned height."""
    level = plan(context, action)
    X_BT = level.X_BT.copy()
    X_BT[:, 2, 3] += height_m
    raised = ToolMotion(level.t_s, X_BT, level.contact)
    X_BO = rollout.rest_pose(context, world.parameters, world.nuisance, world.unmodelled)
    readings = rollout.readings(raised, X_BO, world.parameters, world.nuisance, world.unmodelled)
    return TASK.score(rollout.track_of(readings, level), context)


def at_heights(world: World, drawn: tuple[Array, Array]) -> list[float]:
    """The rewards of one draw (context, executed action) at all `HEIGHTS_MM`."""
    return [scooped(world, 1e-3 * height, *drawn) for height in HEIGHTS_MM]


def as_planned(world: World, drawn: tuple[Array, Array]) -> float:
    """The reward of one draw with the edge at its planned height."""
    return scooped(world, 0.0, *drawn)


def draws(policy: object, n: int, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """`n` places with the action of the policy as it is executed, with its error."""
    contexts = TASK.context.sample(rng, n)
    errors = Disturbances.at_random(TASK, n, rng).error
    return list(zip(contexts, policy.actions(contexts) + errors, strict=True))  # type: ignore[attr-defined]


def rewards_in(name: str, n: int, seed: int, pool: ProcessPoolExecutor) -> Array:
    """(n, heights) rewards of the policy that is best at the planned height."""
    world, solver = load_world(name, TASK), load_checkpoint(TASK).solver
    candidates = cover(TASK.parameters, CANDIDATES, np.random.default_rng(0))
    policies = solver.policies(candidates[:, None, :], np.random.default_rng(0))
    screening = [drawn for policy in policies for drawn in draws(policy, SCREENED, np.random.default_rng([seed, 1]))]
    screened = np.reshape(list(pool.map(partial(as_planned, world), screening, chunksize=4)), (CANDIDATES, SCREENED))
    best = policies[int(screened.mean(axis=1).argmax())]
    judged = draws(best, n, np.random.default_rng([seed, 2]))
    return np.array(list(pool.map(partial(at_heights, world), judged)))


def by_aim(rewards: Array, spread_mm: float, seed: int) -> Array:
    """(n, aims) mean rewards of every draw over errors of that spread."""
    errors_mm = spread_mm * np.random.default_rng([seed, 3]).standard_normal(ERRORS)
    heights = [np.clip(aim + errors_mm, HEIGHTS_MM[0], HEIGHTS_MM[-1]) for aim in AIMS_MM]
    return np.array([[np.interp(h, HEIGHTS_MM, row).mean() for h in heights] for row in rewards])


def table(head: Sequence[float], rewards: Array, against: int) -> None:
    """The mean of every column, and its difference from one of them with a 95 % interval over paired draws."""
    apart = rewards - rewards[:, [against]]
    half = 1.96 * apart.std(axis=0, ddof=1) / len(rewards) ** 0.5
    for at, mean, more, wide in zip(head, rewards.mean(axis=0), apart.mean(axis=0), half, strict=True):
        print(f"    {at:+5.2f} mm  {mean:.3f}  {more:+.3f} ± {wide:.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="keep all rewards, as .npz")
    asked = parser.parse_args()
    logging.getLogger("drake").setLevel(logging.ERROR)
    everything: dict[str, Array] = {}
    with ProcessPoolExecutor(asked.workers) as pool:
        for name in asked.worlds:
            started_s = time.monotonic()
            rewards = everything[name] = rewards_in(name, asked.draws, asked.seed, pool)
            print(f"{name}: {asked.draws} draws, {time.monotonic() - started_s:.0f} s")
            print("  by height of the edge over the planned one: reward, and against height 0")
            table(HEIGHTS_MM, rewards, HEIGHTS_MM.index(0.0))
            for spread_mm in SPREADS_MM:
                print(f"  by aim, the edge's height uncertain by {spread_mm:g} mm (one sigma): reward, against aim 0")
                table(AIMS_MM, by_aim(rewards, spread_mm, asked.seed), AIMS_MM.index(0.0))
            print(flush=True)
            if asked.out is not None:
                np.savez(asked.out, heights_mm=HEIGHTS_MM, **everything)  # type: ignore[arg-type]
    print("mean of all worlds")
    for spread_mm in SPREADS_MM:
        means = np.mean([by_aim(one, spread_mm, asked.seed).mean(axis=0) for one in everything.values()], axis=0)
        print(f"  {spread_mm:g} mm: " + "  ".join(f"{a:+.2f} {m:.3f}" for a, m in zip(AIMS_MM, means, strict=True)))


if __name__ == "__main__":
    main()
