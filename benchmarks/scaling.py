"""What more workers and more data give.

    python benchmarks/scaling.py --task scooping --workers 1 2 --count 256 --cluster
    python benchmarks/scaling.py --task scooping --workers --dataset build/dataset-scooping --sizes 1000 4000 16000
    python benchmarks/scaling.py --task scooping --workers --predict 2 32 64 1000

First table: rollouts a second on pools of so many processes, once they have started and imported what they need; and
rollouts a CPU second, which tells a machine that has other work from cores that do not add up. With `--cluster` also on
a Dask cluster of so many workers on this machine, and the cost of a task to client and scheduler, from tasks that
return a finished result of the usual size at once. With `--dataset` (that folder of `adaptsim pretrain`): what it costs
to train the emulator on so many rollouts drawn from it, and its errors on `--held` others, the same for all sizes.
`--predict`: how long a dataset takes on so many workers, from the cost of a rollout (`--rollout-ms`), what the
scheduler spends on a task (`--scheduler-ms`), and how tasks are cut.
"""

from __future__ import annotations

import argparse
import heapq
import os
import pickle
import resource
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.rollouts import Dataset, Requests, Rollouts, load_dataset, process_pool, run_many, serial_executor
from sim.rollouts.dataset import SHARD
from sim.rollouts.draws import sobol
from sim.rollouts.executors import dask_cluster
from sim.rollouts.run import CALLS, CHUNK
from sim.solvers.emulator.training import held_out_errors, train_emulator
from sim.tasks import get_task
from sim.tasks.task import Task

EMPTY_TASKS = 4000
"""Tasks without work, for the cost of a task."""

Opened = Callable[[int], AbstractContextManager[Executor]]
"""From a number of workers to an executor."""


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    if arguments.workers:
        show_speeds(task, arguments.workers, arguments.count, arguments.cluster)
    if arguments.predict:
        predict(task, arguments.total, arguments.predict, arguments.rollout_ms / 1e3, arguments.scheduler_ms / 1e3)
    if arguments.dataset:
        by_size(task, load_dataset(Path(arguments.dataset), task), arguments.sizes, arguments.held, arguments.seed)


def show_speeds(task: Task, workers: list[int], count: int, cluster: bool) -> None:
    """Print the rollouts a second of each executor with each number of workers."""
    kinds: dict[str, Opened] = {"processes": process_pool}
    if cluster:
        kinds["Dask"] = local_cluster
    print(f"| executor | workers | {task.name} rollouts a second | of one worker | rollouts a CPU second |")
    print("|---|---|---|---|---|")
    for kind, opened in kinds.items():
        first = 0.0
        for number in workers:
            per_s, per_cpu_s = speed(task, opened, number, count)
            first = first or per_s
            print(f"| {kind} | {number} | {per_s:.2f} | {per_s / first:.2f} | {per_cpu_s:.2f} |", flush=True)
    print(f"\n{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end.")
    if cluster:
        show_overhead(task)


@contextmanager
def local_cluster(workers: int) -> Iterator[Executor]:
    """A Dask cluster of processes on this machine, used as `--executor dask` uses any cluster."""
    from distributed import LocalCluster  # noqa: PLC0415 - an extra

    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster,
        dask_cluster(cluster.scheduler_address) as executor,
    ):
        yield executor


def speed(task: Task, opened: Opened, workers: int, count: int) -> tuple[float, float]:
    """Rollouts a second, and a CPU second of the workers."""
    before_s = _children_s()
    with opened(workers) as pool:
        warm = [pool.submit(_warm, task.name) for _ in range(4 * workers)]
        wait(warm)
        started: dict[int, float] = {}
        for pid, cpu_s in (future.result() for future in warm):
            started[pid] = max(cpu_s, started.get(pid, 0.0))
        began_s = time.perf_counter()
        run_many(task, draws(task, count), pool)
        took_s = time.perf_counter() - began_s
    return count / took_s, count / (_children_s() - before_s - sum(started.values()))


def show_overhead(task: Task) -> None:
    """Print the size of a task, and the time that client and scheduler of Dask need for one."""
    requests = draws(task, CHUNK)
    with serial_executor() as here:
        result = run_many(task, requests, here)
    with local_cluster(1) as cluster:
        wait([cluster.submit(_hand_back, requests, result) for _ in range(100)])
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        wait([cluster.submit(_hand_back, requests, result) for _ in range(EMPTY_TASKS)])
        took_s, cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
    sent, returned = len(pickle.dumps(requests)), len(pickle.dumps(result))
    print(
        f"A task of {CHUNK} rollouts: {sent} bytes out, {returned} back. {EMPTY_TASKS} tasks that return a finished "
        f"result take {1e3 * took_s / EMPTY_TASKS:.2f} ms each; of these, client and scheduler, which share this "
        f"process, need {1e3 * cpu_s / EMPTY_TASKS:.2f} ms of CPU."
    )


def predict(task: Task, total: int, workers: list[int], rollout_s: float, scheduler_s: float) -> None:
    """All chunks at once, as they are handed out, and shard by shard, as they were before."""
    whole, size = draws(task, SHARD), min(CHUNK, SHARD // CALLS)
    sent = len(pickle.dumps(whole[:size]))
    print(f"{total} rollouts of {1e3 * rollout_s:g} ms in tasks of {size}; {sent} bytes go out with a task\n")
    print("| workers | shard by shard, s | of them busy | all at once, s | of them busy |\n|---|---|---|---|---|")
    for count in workers:
        one = makespan_s(SHARD // size, count, size * rollout_s, scheduler_s)
        took = [one * -(-total // SHARD), makespan_s(-(-total // size), count, size * rollout_s, scheduler_s)]
        busy = [total * rollout_s / (count * seconds) for seconds in took]
        print(f"| {count} | {took[0]:.0f} | {busy[0]:.2f} | {took[1]:.0f} | {busy[1]:.2f} |")


def makespan_s(tasks: int, workers: int, task_s: float, scheduler_s: float) -> float:
    """A scheduler hands out one task after the other, `scheduler_s` each, to whoever is free first."""
    free_s, clock_s = [0.0] * workers, 0.0
    for _ in range(tasks):
        clock_s = max(clock_s, free_s[0]) + scheduler_s
        heapq.heapreplace(free_s, clock_s + task_s)
    return max(free_s)


def draws(task: Task, count: int) -> Requests:
    """Space-filling rollouts over the margin."""
    p, a = len(task.margin), len(task.action)
    unit = sobol(count, p + a + len(task.nuisance), np.random.default_rng(0))
    return Requests(
        task.margin.spread(unit[:, :p]),
        np.tile(np.asarray(task.reference_context, dtype=np.float64), (count, 1)),
        task.action.spread(unit[:, p : p + a]),
        task.nuisance.spread(unit[:, p + a :]),
    )


def _warm(task_name: str) -> tuple[int, float]:
    """In a worker: one rollout -> its process, and the CPU time that it has spent so far."""
    task = get_task(task_name)
    with serial_executor() as executor:
        run_many(task, draws(task, 1), executor)
    return os.getpid(), time.process_time()


def _hand_back(requests: Requests, result: Rollouts) -> Rollouts:
    """A task without work."""
    return result


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def by_size(task: Task, dataset: Dataset, sizes: list[int], held: int, seed: int) -> None:
    """Train on nested random subsets, judge all on the same rows, which lie evenly over the space."""
    rng = np.random.default_rng(seed)
    even = rng.permutation(dataset.uniform)
    rest = rng.permutation(np.concatenate([even[held:], np.arange(dataset.uniform, len(dataset))]))
    wanted = [n for n in sizes if n <= len(rest)] or [len(rest)]
    if left_out := [n for n in sizes if n > len(rest)]:
        print(f"left out, {len(dataset)} rollouts less {held} held out are too few: {left_out}")
    print(f"\n{task.name}: {len(dataset)} rollouts in the folder, {held} held out\n")
    print("| rollouts | training, s | CPU s | outcome right | Brier | XY median, mm | XY p90, mm |")
    print("|---|---|---|---|---|---|---|")
    judges = select_rows(dataset, even[:held])
    requests = Requests(
        judges.parameters,
        np.tile(np.asarray(task.reference_context, dtype=np.float64), (held, 1)),
        judges.action,
        judges.nuisance,
    )
    true = Rollouts(judges.observation, judges.end_state, judges.succeeded, judges.outcome)
    for n in wanted:
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        emulator, _ = train_emulator(task, select_rows(dataset, rest[:n]), seed)
        took_s, cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
        errors = held_out_errors(emulator, requests, true)
        off_mm = 1e3 * errors["position_error_median"]
        print(
            f"| {n} | {took_s:.0f} | {cpu_s:.0f} | {errors['accuracy'].mean():.3f} | {errors['brier'].mean():.4f} | "
            f"{np.median(off_mm):.1f} | {np.quantile(off_mm, 0.9):.0f} |",
            flush=True,
        )


def select_rows(dataset: Dataset, rows: NDArray[np.intp]) -> Dataset:
    """A dataset of some of its rollouts: those that lie evenly come first, as always."""
    rows = np.concatenate([rows[rows < dataset.uniform], rows[rows >= dataset.uniform]])
    columns: dict[str, Any] = {}
    for field in fields(dataset):
        value = getattr(dataset, field.name)
        if isinstance(value, np.ndarray):
            columns[field.name] = value[rows]
    return replace(dataset, uniform=int((rows < dataset.uniform).sum()), **columns)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--cluster", action="store_true", help="also a Dask cluster on this machine")
    parser.add_argument("--predict", type=int, nargs="*", default=[], help="numbers of workers")
    parser.add_argument("--total", type=int, default=16_384, help="rollouts of the predicted dataset")
    parser.add_argument("--rollout-ms", type=float, default=130.0)
    parser.add_argument("--scheduler-ms", type=float, default=3.2, help="per task; `--cluster` measures it")
    parser.add_argument("--count", type=int, default=256, help="rollouts that are timed")
    parser.add_argument("--dataset", default="", help="folder of a dataset")
    parser.add_argument("--sizes", type=int, nargs="*", default=[1000, 2000, 4000, 8000, 16000, 32000, 64000])
    parser.add_argument("--held", type=int, default=1000, help="rollouts that judge")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args()


if __name__ == "__main__":
    main()
