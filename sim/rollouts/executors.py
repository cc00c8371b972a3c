"""Where rollouts run: beside this thread, or in a pool of fresh processes. A Dask cluster brings its own Executor."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

_PR_SET_PDEATHSIG = 1


def serial_executor() -> ThreadPoolExecutor:
    """One rollout after the other in this process: no start-up time, and one core."""
    return ThreadPoolExecutor(1, thread_name_prefix="rollouts")


def process_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """A pool of `workers` fresh processes (default: one a core), safe beside threads and loaded libraries.

    An interrupt is the business of the process that waits for them; on Linux none of them outlives it, however it ends.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers or os.cpu_count() or 1, mp_context=context, initializer=_serve)


def _serve() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
