"""Executors of rollouts: a thread, a pool of fresh processes, or the workers of a cluster."""

from __future__ import annotations

import ctypes
import multiprocessing
import signal
import sys
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager

from hw.cores import usable_cores
from sim.rollouts.cluster import Warn, dask_cluster

_PR_SET_PDEATHSIG = 1


def simulating_executor(
    workers: int = 0, scheduler: str = "", warn: Warn = lambda sentence: None
) -> AbstractContextManager[Executor]:
    """Where a command simulates: on the workers of the Dask `scheduler`, if it names one; else on `workers` processes
    of this computer (0: one per usable core). The numbers are the same. `warn` and errors: see `dask_cluster`.
    """
    return dask_cluster(scheduler, warn) if scheduler else process_pool(workers or None)


def serial_executor() -> ThreadPoolExecutor:
    """One rollout after another in this process: no start-up time, one core."""
    return ThreadPoolExecutor(1, thread_name_prefix="rollouts")


def process_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """A pool of `workers` fresh processes (default: one per usable core), safe with threads and loaded libraries.

    Only the waiting process handles an interrupt. On Linux no worker outlives it, however it ends.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers or usable_cores(), mp_context=context, initializer=_serve)


def _serve() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
