"""Where rollouts run: beside this thread, or in a pool of fresh processes. A Dask cluster brings its own Executor."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor


def serial_executor() -> ThreadPoolExecutor:
    """One rollout after the other in this process: no start-up time, and one core."""
    return ThreadPoolExecutor(1, thread_name_prefix="rollouts")


def process_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """A pool of `workers` fresh processes (default: one a core), safe beside threads and loaded libraries."""
    return ProcessPoolExecutor(workers or os.cpu_count() or 1, mp_context=multiprocessing.get_context("spawn"))
