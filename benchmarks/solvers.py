"""Two ways to a task policy: the emulator's, and the paper's NAF on true rollouts alone.

    python benchmarks/solvers.py --task scooping --policies 20 --visits 4
    python benchmarks/solvers.py --task pushing --policies 20 --scale 0.1

For each of `--policies` parameter vectors that fill the ranges: the policy of the checkpoint's emulator, and NAF's with
the budget M of Table A1 from scratch; with more `--visits` also after it was trained on by the rules of reuse, until
M_max (the fourth visit). `--scale` makes all of NAF's budgets smaller. All are judged by `--rollouts` fresh true ones
in a simulator with exactly these parameters, at the same contexts, with the same executed error and nuisance for all.

CPU seconds are those of one core, rollouts included. Rollouts are kept in the cache, so that a second run, or one with
more policies or visits, only adds what is missing.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.research.naf.memory import NafMemory
from sim.research.naf.solver import NafSolver, rules_of
from sim.rollouts import Requests, Rollouts
from sim.rollouts.cache import CachedRollouts
from sim.rollouts.draws import cover, trial_requests
from sim.solvers.solver import SolvedPolicy, policy_for
from sim.storage.files import write_toml
from sim.tasks import get_task
from sim.tasks.scene_key import scene_key
from sim.tasks.task import Task

BOOTSTRAP = 4000


@dataclass(frozen=True)
class Settings:
    """What decides a result, beside the scene."""

    task: str
    checkpoint: str
    visits: int
    scale: float
    rollouts: int
    seed: int


@dataclass(frozen=True)
class Result:
    """One policy, judged."""

    solver: str
    budget: int  # true rollouts that went into it
    cpu_s: float  # theirs included
    rewards: tuple[float, ...]  # of the judging rollouts


class TimedExecutor(Executor):
    """Runs at once in this thread and adds up what that costs."""

    def __init__(self) -> None:
        self.cpu_s = 0.0
        self.rollouts = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        began = time.process_time()
        try:
            result = fn(*args, **kwargs)
            self.rollouts += len(result)
            future.set_result(result)
        except Exception as error:  # noqa: BLE001 - as every executor does
            future.set_exception(error)
        self.cpu_s += time.process_time() - began
        return future


class TimedRollouts:
    """Cached rollouts, and the CPU time of those in the cache, which outlives the process."""

    def __init__(self, task: Task, folder: Path) -> None:
        self._executor = TimedExecutor()
        self._cached = CachedRollouts(task, folder, self._executor)
        self._log = folder / "cpu.jsonl"

    def __call__(self, requests: Requests) -> Rollouts:
        before = self._executor.cpu_s, self._executor.rollouts
        results = self._cached(requests)
        spent_s, count = self._executor.cpu_s - before[0], self._executor.rollouts - before[1]
        if count:
            with self._log.open("a") as out:
                out.write(json.dumps({"rollouts": count, "cpu_s": spent_s}) + "\n")
        return results

    @property
    def here_s(self) -> float:
        """Spent by this process."""
        return self._executor.cpu_s

    @property
    def cpu_s(self) -> float:
        """Spent on all that is in the cache."""
        lines = self._log.read_text().splitlines() if self._log.exists() else []
        return float(sum(json.loads(line)["cpu_s"] for line in lines))


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    settings = Settings(
        task.name, arguments.checkpoint, arguments.visits, arguments.scale, arguments.rollouts, arguments.seed
    )
    checkpoint = load_checkpoint(task, settings.checkpoint)
    dataset = checkpoint.card.emulator.rollouts if checkpoint.card.emulator else 0
    rules = rules_of(task, settings.scale)
    cache = Path(arguments.cache or f"build/solvers-{task.name}") / scene_key(task)
    means = cover(task.parameters, arguments.policies, np.random.default_rng(settings.seed))
    print(
        f"{task.name}: {len(means)} parameter vectors, judged by {settings.rollouts} rollouts each. NAF: M = "
        f"{rules.first_budget}, M_max = {rules.max_budget}, M_min = {rules.least_budget}, alpha = {rules.discount}"
    )
    print(
        f"The emulator ({checkpoint.path.name}, {checkpoint.sha256[:12]}) rests on {dataset} rollouts, once for all.\n"
    )
    rows: list[list[Result]] = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.workers, mp_context=context) as pool:
        judge = partial(judged, settings, checkpoint.sha256, cache)
        for mean, results in zip(means, pool.map(judge, means), strict=True):
            rows.append(results)
            told = ", ".join(f"{r.solver} {np.mean(r.rewards):.2f} ({r.cpu_s:.0f} s)" for r in results)
            print(f"{task.parameters.names} = {np.array2string(mean, precision=3)}: {told}", flush=True)
    print("\n" + table(rows))


def judged(settings: Settings, checkpoint_sha256: str, cache: Path, mean: Array) -> list[Result]:
    """Both solvers' policies for `mean` (p,), from the cache as far as it goes."""
    task = get_task(settings.task)
    stem = "-".join(f"{v:.6g}" for v in mean)
    roll = TimedRollouts(task, cache / f"E-{stem}-scale{settings.scale:g}-seed{settings.seed}")
    rng = np.random.default_rng(settings.seed + 1)
    contexts = task.context.sample(rng, settings.rollouts)
    noise = int(rng.integers(2**31))

    def result(name: str, policy: SolvedPolicy, budget: int, cpu_s: float) -> Result:
        actions = policy.actions(contexts)
        where = np.tile(mean, (len(contexts), 1))
        requests = trial_requests(task, where, contexts, actions, np.random.default_rng(noise))
        judge = CachedRollouts(task, cache / "judging", TimedExecutor())
        return Result(name, budget, round(cpu_s, 2), tuple(judge(requests).rewards(task, contexts).tolist()))

    checkpoint = load_checkpoint(task, settings.checkpoint)
    began_s = time.process_time()
    policy: SolvedPolicy = policy_for(checkpoint.solver, mean[None], seed=settings.seed)
    policy.actions(contexts)
    results = [result("emulator", policy, 0, time.process_time() - began_s)]
    solver = NafSolver(task, roll, rules_of(task, settings.scale), NafMemory(task))
    learning_s = 0.0
    for visit in range(settings.visits):
        began_s, simulated_s = time.process_time(), roll.here_s
        policy = policy_for(solver, mean[None], seed=settings.seed + visit)
        learning_s += time.process_time() - began_s - (roll.here_s - simulated_s)
        budget = solver.memory.record[-1].budget
        results.append(result(f"naf, {budget} rollouts", policy, budget, roll.cpu_s + learning_s))
    write_toml(
        cache / f"E-{stem}-scale{settings.scale:g}-seed{settings.seed}.toml",
        {
            "parameters": mean.tolist(),
            "checkpoint_sha256": checkpoint_sha256,
            "settings": asdict(settings),
            "results": [{**asdict(r), "rewards": list(r.rewards)} for r in results],
        },
    )
    return results


def table(rows: Sequence[Sequence[Result]]) -> str:
    """One row a solver: means over the parameter vectors, with 95 % bootstrap intervals over them."""
    rewards = np.array([[np.mean(r.rewards) for r in row] for row in rows])  # (E, solvers)
    lines = [
        "| solver | rollouts a policy | CPU s a policy | reward in true Drake | minus the emulator's |",
        "|---|---|---|---|---|",
    ]
    for j, first in enumerate(rows[0]):
        cpu_s = np.mean([row[j].cpu_s for row in rows])
        less = "" if j == 0 else interval(rewards[:, j] - rewards[:, 0], "+")
        lines.append(f"| {first.solver} | {first.budget} | {cpu_s:.2f} | {interval(rewards[:, j])} | {less} |")
    n, within = len(rows[0][0].rewards), np.mean([[np.var(r.rewards) for r in row] for row in rows])
    error = (within / n / len(rows)) ** 0.5
    lines.append(f"\nOf the intervals, the {n} judging rollouts of each policy make {1.96 * error:.3f} either way.")
    return "\n".join(lines)


def interval(values: Array, sign: str = "") -> str:
    """Mean of (n,) with its 95 % bootstrap interval."""
    rows = np.random.default_rng(0).integers(len(values), size=(BOOTSTRAP, len(values)))
    low, high = np.quantile(values[rows].mean(axis=1), [0.025, 0.975])
    return f"{values.mean():{sign}.3f} ({low:{sign}.3f} to {high:{sign}.3f})"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--checkpoint", default="default", help="name of a shipped checkpoint, or a folder")
    parser.add_argument("--policies", type=int, default=20)
    parser.add_argument("--visits", type=int, default=1, help="1: M rollouts; 4: until M_max")
    parser.add_argument("--scale", type=float, default=1.0, help="of NAF's budgets")
    parser.add_argument("--rollouts", type=int, default=40, help="that judge a policy")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--cache", default="", help="default: build/solvers-TASK")
    return parser.parse_args()


if __name__ == "__main__":
    main()
