"""Rollouts by a pool of processes and by Dask workers of this computer: time at 1 and 2 workers, and equal numbers.

    python benchmarks/scaling.py [--task scooping] [--rollouts 48]
    python benchmarks/scaling.py --slope 1000 10000 100000 1000000

At the end one of two Dask workers is killed half-way. Every line says whether its rollouts equal the first one's.
With --slope the simulator costs nothing, so that only the handing out of work is timed. The time of each rollout must
not grow with their number.
"""

from __future__ import annotations

import argparse
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
from distributed import LocalCluster

from sim.rollouts.cluster import dask_cluster
from sim.rollouts.dataset import dataset_requests
from sim.rollouts.executors import process_pool
from sim.rollouts.run import Requests, Rollouts, run_many
from sim.tasks import get_task
from sim.tasks.task import Task


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--rollouts", type=int, default=48)
    parser.add_argument("--slope", type=int, nargs="*", default=[], help="numbers of rollouts that cost nothing")
    asked = parser.parse_args()
    if asked.slope:
        slope(sorted(asked.slope))
        return
    task = get_task(asked.task)
    requests = dataset_requests(task, 0, asked.rollouts)
    expected: Rollouts | None = None

    def show(name: str, executor: Executor, progress: Callable[[int, int], None] = lambda done, total: None) -> None:
        nonlocal expected
        rollouts, seconds = timed(task, requests, executor, progress)
        expected = expected or rollouts
        load = os.getloadavg()[0]
        print(f"{name}: {seconds:.1f} s, equal: {equal(rollouts, expected)}, load {load:.1f}", flush=True)

    for workers in (1, 2):
        with process_pool(workers) as pool:
            show(f"pool of {workers}", pool)
        with local(workers) as cluster, dask_cluster(cluster.scheduler_address) as dask:
            show(f"{workers} Dask workers", dask)
    with local(2) as cluster, dask_cluster(cluster.scheduler_address) as dask:
        killed: list[int] = []

        def kill(done: int, total: int) -> None:
            if not killed and 2 * done >= total:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        show("2 Dask workers, one killed half-way", dask, kill)


def slope(numbers: list[int]) -> None:
    """Print the time of each rollout for several numbers of rollouts, one after another on one thread."""
    real = get_task("pendulum")
    track = real.simulate(*(space.middle for space in (real.parameters, real.context, real.action, real.nuisance)))
    task = replace(real, simulate=lambda *_: track, simulate_many=None)
    for number in numbers:
        with ThreadPoolExecutor(1) as executor:
            _, seconds = timed(task, dataset_requests(task, 0, number), executor, lambda done, total: None)
        print(f"{number} rollouts: {1e6 * seconds / number:.0f} µs each, {seconds:.1f} s", flush=True)


def timed(
    task: Task, requests: Requests, executor: Executor, progress: Callable[[int, int], None]
) -> tuple[Rollouts, float]:
    """The rollouts and their seconds, once every worker has loaded the task."""
    run_many(task, dataset_requests(task, 1, 8), executor)
    before = time.perf_counter()
    return run_many(task, requests, executor, progress), time.perf_counter() - before


def equal(one: Rollouts, two: Rollouts) -> bool:
    """Whether both hold the same numbers."""
    return all(np.array_equal(getattr(one, f.name), getattr(two, f.name), equal_nan=True) for f in fields(one))


def local(workers: int) -> LocalCluster:
    """Dask workers of this computer, all of their ports on 127.0.0.1."""
    return LocalCluster(
        n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0", silence_logs=50
    )


if __name__ == "__main__":
    main()
