"""Whether coarse rollouts help an emulator: the same cost spent on accurate rollouts alone, or on both kinds.

    python benchmarks/coarse.py --task pushing --coarse-step 0.010 --fine 10240 --coarse 16384 --folder build/coarse \
        --mixes 7000+0/one-sided 3500+10500/one-sided 3500+10500

Draws accurate rollouts, coarse ones (the contact law of training, a longer step) and 2,048 held-out accurate ones,
evenly over the margin. For each mix A+C and each seed it trains an emulator on A accurate and C coarse rollouts, chosen
at random, and prints the errors on the held-out ones. In a task with a mirror symmetry A+C/one-sided learns without the
mirror images. `cost` is in accurate rollouts, from the CPU times of both kinds, measured in turns. With --policies N
also what the emulators' policies earn in N environments of Omega by true rollouts, each mix minus the first one, in the
same environments, contexts and disturbances. Rollouts are kept in the folder, so a stopped run goes on.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.rollouts import process_pool, run_many
from sim.rollouts.cache import CachedRollouts
from sim.rollouts.dataset import SHARD, Dataset, coarsely, draw_requests
from sim.rollouts.draws import cover, trial_requests
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import Requests, Rollouts, concatenate, run_parts
from sim.rollouts.shards import read_rollouts, write_rollouts
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.solver import EmulatorSolver
from sim.solvers.emulator.training import held_out_errors, train_emulator
from sim.solvers.solver import Solver
from sim.tasks import get_task
from sim.tasks.task import Task

FINE, COARSE, HELD_OUT = 1, 2, 3
"""Seeds of the three draws."""
HELD = 2048
TIMED = 40
"""Rollouts of each kind for the ratio of their costs."""
ONE_SIDED = "/one-sided"
CONTEXTS, REPEATS = 4, 4
"""Per environment: contexts, and true rollouts at each."""

Pool = tuple[Requests, Rollouts]


@dataclass(frozen=True)
class Mix:
    """Numbers of accurate and coarse rollouts, and whether each counts twice in a task with a mirror symmetry."""

    fine: int
    coarse: int
    mirrored: bool = True

    @classmethod
    def parse(cls, text: str) -> Mix:
        """From "A+C", or "A+C/one-sided"."""
        numbers = text.removesuffix(ONE_SIDED)
        fine, coarse = map(int, numbers.split("+"))
        return cls(fine, coarse, mirrored=numbers == text)

    def __str__(self) -> str:
        return f"{self.fine}+{self.coarse}{'' if self.mirrored else ONE_SIDED}"


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    cheap = coarsely(replace(task, coarse=task.unmodelled(dt_s=arguments.coarse_step)))
    mixes = [Mix.parse(text) for text in arguments.mixes]
    with process_pool(arguments.workers) as executor:
        named = f"{task.name}-{{}}".format
        fine = pool(task, arguments.fine, FINE, arguments.folder / named("fine"), executor)
        coarse = pool(cheap, arguments.coarse, COARSE, arguments.folder / named("coarse"), executor)
        held = pool(task, HELD, HELD_OUT, arguments.folder / named("held"), executor)
        ratio = cost_ratio(task, cheap)
        print(
            f"{task.name}: a coarse rollout ({1e3 * arguments.coarse_step:g} ms) costs {ratio:.2f} of an accurate one"
        )
        print(
            "mix | cost | outcome right | Brier | XY median / p90, mm | end state of a success, mm (standard deviation)"
        )
        emulators = {}
        for mix in mixes:
            learnt = task if mix.mirrored else replace(task, mirror=None)
            emulators[mix] = [trained(learnt, mixed(mix, fine, coarse, seed), seed) for seed in arguments.seeds]
            errors = np.array([figures(emulator, held) for emulator in emulators[mix]])
            told = [f"{m:.4g} ({s:.2g})" for m, s in zip(errors.mean(axis=0), errors.std(axis=0), strict=True)]
            cost = mix.fine + ratio * mix.coarse
            print(f"{mix} | {cost:.0f} | {told[0]} | {told[1]} | {told[2]} / {told[3]} | {told[4]}", flush=True)
        if arguments.policies:
            roll = CachedRollouts(task, arguments.folder / "judged", executor)
            show_policies(emulators, arguments.policies, roll)


def pool(task: Task, size: int, seed: int, folder: Path, executor: Executor) -> Pool:
    """`size` rollouts evenly over the margin, kept in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    requests = draw_requests(task, size, np.random.default_rng(seed))
    parts = {folder / f"shard-{i // SHARD:05d}.npz": requests[i : i + SHARD] for i in range(0, size, SHARD)}
    there = {path: read_rollouts(path, part) for path, part in parts.items()}
    missing = [path for path, rollouts in there.items() if rollouts is None]
    if missing:
        made = run_parts(task, [parts[path] for path in missing], executor)
        for path, rollouts in zip(missing, made, strict=True):
            write_rollouts(path, parts[path], rollouts)
            there[path] = rollouts
            print(f"{path.name} of {len(parts)}", flush=True)
    return requests, concatenate(rollouts for rollouts in there.values() if rollouts is not None)


def cost_ratio(task: Task, cheap: Task) -> float:
    """The CPU time of a coarse rollout in those of an accurate one."""
    spent_s = {True: 0.0, False: 0.0}
    requests = draw_requests(task, TIMED, np.random.default_rng(0))
    with serial_executor() as here:
        for i in range(TIMED):
            for is_cheap in spent_s:
                before_s = time.process_time()
                run_many(cheap if is_cheap else task, requests[i : i + 1], here)
                spent_s[is_cheap] += time.process_time() - before_s
    return spent_s[True] / spent_s[False]


def mixed(mix: Mix, fine: Pool, coarse: Pool, seed: int) -> Dataset:
    """A dataset of random rollouts of both pools, the accurate ones first."""
    rng = np.random.default_rng([seed, 7])
    parts = [(source, rng.permutation(len(source[0]))[:n]) for source, n in ((fine, mix.fine), (coarse, mix.coarse))]
    if any(len(rows) < n for (_, rows), n in zip(parts, (mix.fine, mix.coarse), strict=True)):
        raise SystemExit(f"{mix}: only {len(fine[0])} accurate and {len(coarse[0])} coarse rollouts were drawn")

    def column(half: int, name: str) -> Any:
        return np.concatenate([getattr(source[half], name)[rows] for source, rows in parts])

    columns = {name: column(0, name) for name in ("parameters", "action", "nuisance")}
    columns |= {f.name: column(1, f.name) for f in fields(Rollouts)}
    return Dataset(**columns, coarse=np.arange(mix.fine + mix.coarse) >= mix.fine, uniform=mix.fine, identity="")


def trained(task: Task, dataset: Dataset, seed: int) -> Emulator:
    """An emulator of the dataset."""
    return train_emulator(task, dataset, seed)[0]


def figures(emulator: Emulator, held: Pool) -> Array:
    """(5,) held-out errors; lengths in mm."""
    errors = held_out_errors(emulator, *held)
    position, end = errors["position_error_median"], errors["end_state_error_median"]
    lengths_mm = [1e3 * value for value in (np.median(position), np.quantile(position, 0.9), np.median(end))]
    return np.array([errors["accuracy"].mean(), errors["brier"].mean(), *lengths_mm])


def show_policies(emulators: dict[Mix, list[Emulator]], environments: int, roll: CachedRollouts) -> None:
    """Print what the policies earn in their own environments, and the differences to the first mix."""
    earned = {
        mix: np.array([earned_by(EmulatorSolver(emulator), environments, roll) for emulator in made])
        for mix, made in emulators.items()
    }
    first = next(iter(earned.values()))
    print(
        f"mix | reward in {environments} E by {CONTEXTS * REPEATS} true rollouts each | minus the first (95 %, over E)"
    )
    for mix, rewards in earned.items():
        low, high = interval((rewards - first).mean(axis=0))
        by_seed = ", ".join(f"{r:+.3f}" for r in (rewards - first).mean(axis=1))
        apart = (rewards - first).mean()
        print(f"{mix} | {rewards.mean():.4f} | {apart:+.4f} ({low:+.4f} to {high:+.4f}); by seed {by_seed}", flush=True)


def earned_by(solver: Solver, environments: int, roll: CachedRollouts) -> Array:
    """(environments,) mean true reward of the solver's policies, each in its own environment."""
    task = solver.task
    E = cover(task.parameters, environments, np.random.default_rng(4))
    contexts = cover(task.context, CONTEXTS, np.random.default_rng(5))
    policies = solver.policies(E[:, None], np.random.default_rng(6))
    actions = np.stack([policy.actions(contexts) for policy in policies])  # (E, CONTEXTS, a)
    repeated = np.repeat(actions.reshape(-1, actions.shape[-1]), REPEATS, axis=0)
    where = np.repeat(np.tile(contexts, (len(E), 1)), REPEATS, axis=0)
    targets = np.repeat(E, CONTEXTS * REPEATS, axis=0)
    requests = trial_requests(task, targets, where, repeated, np.random.default_rng(8))
    return np.asarray(roll(requests).rewards(task, where).reshape(len(E), -1).mean(axis=1))


def interval(differences: Array) -> tuple[float, float]:
    """95 % of bootstrapped means of (n,) differences."""
    rng = np.random.default_rng(9)
    means: Sequence[float] = differences[rng.integers(len(differences), size=(4000, len(differences)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pushing")
    parser.add_argument("--coarse-step", type=float, default=0.010, help="s")
    parser.add_argument("--fine", type=int, default=2048, help="accurate rollouts to draw")
    parser.add_argument("--coarse", type=int, default=4096, help="coarse rollouts to draw")
    parser.add_argument("--mixes", nargs="+", default=["2048+0", "1024+3072"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--policies", type=int, default=0, help="environments in which policies are judged")
    parser.add_argument("--folder", type=Path, default=Path("build/coarse"))
    parser.add_argument("--workers", type=int)
    return parser.parse_args()


if __name__ == "__main__":
    main()
