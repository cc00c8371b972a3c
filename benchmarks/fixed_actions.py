"""One action for all drawn foods: how much of the gain over UDR would a luckier fixed action have earned?

Every action of a grid scoops every food of the set `foods` (true rollouts). Within a food all actions share the drawn
places and errors. The emulator's reward over Omega, by which UDR chooses, is printed beside that in the foods. The best
fixed action is chosen in the foods with even numbers and scored in the others, and the other way round: it is a bound,
because no lab knows forty foods beforehand. Stop it at any time: the same command continues.

    python benchmarks/fixed_actions.py --out build/fixed-actions
"""

from __future__ import annotations

import argparse
import json
import logging
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.lab.rollout import rollout_in
from sim.research.benchmark.sessions import udr_policies
from sim.research.benchmark.worlds import targets_of
from sim.rollouts.draws import Disturbances, cover
from sim.storage.files import whole_file
from sim.tasks import get_task
from sim.tasks.task import SolvedPolicy, Solver

TASK = get_task("scooping")
RATES, PITCHES, DISTANCES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7), (0.0, 0.2), (1.0,)
"""The grid, in fractions of the ranges: flat and from far behind the piece, as UDR, lifted early to late."""

E, DRAWS, CONTEXTS = 64, 4, 8
"""For the emulator's reward: parameters over Omega, disturbances, contexts."""


def grid() -> Array:
    """(A, a) the actions, in units."""
    axes = np.meshgrid(RATES, PITCHES, DISTANCES, indexing="ij")
    return TASK.action.denormalise(np.stack(axes, axis=-1).reshape(-1, 3))


def draws(
    name: str, number: int, policies: Sequence[SolvedPolicy], n: int, seed: int
) -> tuple[str, Array, Array, Array]:
    """A food's name, the actions of UDR's policies (P, D, a), places (D, c) and errors (D, a)."""
    rng = np.random.default_rng([seed, number])
    contexts = TASK.context.sample(rng, n)
    errors = Disturbances.at_random(TASK, n, rng).error
    return name, np.stack([policy.actions(contexts) for policy in policies]), contexts, errors


def rewards_in(drawn: tuple[str, Array, Array, Array]) -> list[float]:
    """(A + 1,) rewards of the grid's actions, and the mean of UDR's policies (P, D, a), in one food, averaged over D
    places (D, c) and errors (D, a).
    """
    name, udr, contexts, errors = drawn
    (target,) = targets_of(TASK, (name,))

    def earned(actions: Array) -> float:
        trials = zip(contexts, actions + errors, strict=True)
        return float(np.mean([TASK.score(rollout_in(target.world, place, action), place) for place, action in trials]))

    fixed = [earned(np.tile(action, (len(contexts), 1))) for action in grid()]
    return [*fixed, float(np.mean([earned(actions) for actions in udr]))]


def expected(solver: Solver, actions: Array) -> Array:
    """(A,) the emulator's rewards over Omega."""
    parameters = cover(TASK.parameters, E, np.random.default_rng(1))
    contexts = np.stack([cover(TASK.context, CONTEXTS, np.random.default_rng(0))] * E)
    each = (np.broadcast_to(action, (E, CONTEXTS, len(action))) for action in actions)
    rng = np.random.default_rng
    return np.array([solver.expected_rewards(parameters, contexts, one, rng(2), DRAWS).mean() for one in each])


def interval(values: Array) -> str:
    """The mean over foods with its 95 % interval by bootstrap."""
    low, high = np.quantile(np.random.default_rng(0).choice(values, (10_000, len(values))).mean(axis=1), (0.025, 0.975))
    return f"{values.mean():.3f} ({low:.3f} to {high:.3f})"


def show(rewards: Array, expectation: Array) -> None:
    """Print the map, and the best fixed action."""
    fixed, udr = rewards[:, :-1], rewards[:, -1]
    shape = (len(RATES), len(PITCHES), len(DISTANCES))
    actions, true, said = (v.reshape(*shape, -1) for v in (grid(), fixed.mean(axis=0), expectation))
    for axis in range(len(DISTANCES)):
        print(f"distance {1e3 * actions[0, 0, axis, 2]:.1f} mm; reward in the foods / by the emulator over Omega")
        print("   rad/s " + " ".join(f"{pitch:7.3f} rad" for pitch in actions[0, :, axis, 1]))
        for row, rate in enumerate(actions[:, 0, axis, 0]):
            pairs = zip(true[row, :, axis, 0], said[row, :, axis, 0], strict=True)
            print(f"  {rate:+6.2f} " + " ".join(f"{a:.2f} / {b:.2f}" for a, b in pairs))
    even = np.arange(len(rewards)) % 2 == 0
    chosen = np.where(even, fixed[~even].mean(axis=0).argmax(), fixed[even].mean(axis=0).argmax())
    best = fixed[np.arange(len(fixed)), chosen]
    print(f"UDR {interval(udr)}; the best fixed action {interval(best)}, minus UDR {interval(best - udr)}")
    alike = expectation >= expectation.max() - 0.02
    earned = fixed.mean(axis=0)[alike]
    print(
        f"{alike.sum()} of {len(alike)} actions are within 0.02 of the best by the emulator ({expectation.max():.3f}); "
        f"in the foods they earn {earned.min():.2f} to {earned.max():.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1, help="places in each food")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/fixed-actions"), help="folder of the results")
    asked = parser.parse_args()
    logging.getLogger("drake").setLevel(logging.ERROR)
    folder = asked.out / f"seed-{asked.seed}-draws-{asked.draws}-actions-{len(grid())}"
    folder.mkdir(parents=True, exist_ok=True)
    solver = load_checkpoint(TASK).solver
    policies = udr_policies(solver, asked.seed)
    names = [target.name for target in targets_of(TASK, ("foods",))]
    missing = [name for name in names if not (folder / f"{name}.json").exists()]
    with ProcessPoolExecutor(asked.workers) as pool:
        jobs = (draws(name, names.index(name), policies, asked.draws, asked.seed) for name in missing)
        for name, row in zip(missing, pool.map(rewards_in, jobs), strict=True):
            with whole_file(folder / f"{name}.json") as temporary:
                temporary.write_text(json.dumps(row))
            print(f"{name} ({names.index(name) + 1} of {len(names)})", flush=True)
    rewards = np.array([json.loads((folder / f"{name}.json").read_text()) for name in names])
    show(rewards, expected(solver, grid()))


if __name__ == "__main__":
    main()
