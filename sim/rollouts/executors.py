"""Executors of rollouts: a thread, a pool of fresh processes, or the workers of a cluster."""

from __future__ import annotations

import re
import runpy
import sys
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from types import ModuleType

from hw.computer import usable_cores
from sim.rollouts.cluster import Warn, dask_cluster

_WORKER = str(Path(__file__).with_name("worker.py"))
"""Workers run this file by its path. Otherwise a worker that unpickles one of our functions could import a user's `sim`
instead."""


def simulating_executor(
    workers: int = 0, scheduler: str = "", warn: Warn = lambda sentence: None
) -> AbstractContextManager[Executor]:
    """The executor of a command: the workers of the Dask `scheduler`, if it names one, else `workers` processes of this
    computer (0: one per usable core). The numbers are the same. `warn` and errors: see `dask_cluster`.
    """
    return dask_cluster(scheduler, warn) if scheduler else process_pool(workers or None)


def serial_executor() -> ThreadPoolExecutor:
    """Runs one rollout after another in this process, on one core and without start-up time."""
    return ThreadPoolExecutor(1, thread_name_prefix="rollouts")


def process_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """A pool of `workers` fresh processes (default: one per usable core), safe with threads and loaded libraries.

    Only the waiting process handles an interrupt. On Linux, no worker outlives this process, however it ends.
    """
    size = workers or usable_cores()
    return ProcessPoolExecutor(size, mp_context=_FreshContext(), initializer=runpy.run_path, initargs=(_WORKER,))


_GUARD = re.compile(r"__name__\s*==|==\s*__name__")


class _FreshProcess(SpawnProcess):
    """Keeps a worker from running a script again that begins its work without `if __name__ == "__main__":`."""

    def start(self) -> None:
        """See `Process`."""
        # A worker unpickles this object before anything else, and may take a user's `sim` for ours.
        self.__class__ = SpawnProcess  # type: ignore[assignment]
        main = sys.modules["__main__"]
        if _is_guarded(getattr(main, "__file__", None)):
            SpawnProcess.start(self)
            return
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            SpawnProcess.start(self)
        finally:
            sys.modules["__main__"] = main


class _FreshContext(SpawnContext):
    Process = _FreshProcess


def _is_guarded(file: str | None) -> bool:
    """Whether a worker may import a script: only a script that compares its name may be imported.

    Without a file nothing is imported.
    """
    try:
        return file is None or bool(_GUARD.search(Path(file).read_text(encoding="utf-8", errors="replace")))
    except OSError:
        return True
