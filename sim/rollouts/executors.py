"""Executors of rollouts: a thread, a pool of fresh processes, or the workers of a Dask cluster."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from sim.errors import ClusterUnavailable, RolloutError

CONNECT_S = 15.0
"""How long a cluster may take to answer, and to show its first worker."""

LOST = "the Dask scheduler was lost: start it again, then the same command"

_PR_SET_PDEATHSIG = 1


def serial_executor() -> ThreadPoolExecutor:
    """One rollout after another in this process: no start-up time, one core."""
    return ThreadPoolExecutor(1, thread_name_prefix="rollouts")


def process_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """A pool of `workers` fresh processes (default: one per core), safe with threads and loaded libraries.

    Only the waiting process handles an interrupt. On Linux no worker outlives it, however it ends.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers or os.cpu_count() or 1, mp_context=context, initializer=_serve)


@contextmanager
def dask_cluster(scheduler: str) -> Iterator[Executor]:
    """The workers of a running Dask cluster, `scheduler` being its address, e.g. tcp://10.0.0.1:8786.

    On SLURM, dask-jobqueue starts a cluster and prints its address. If a worker is lost, the scheduler repeats its
    running chunks elsewhere (three times, its `allowed-failures`), and each result is taken once. The numbers are those
    of one machine if the packages are the same. Raises ClusterUnavailable.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ClusterUnavailable(
            "the package distributed is missing: install the extra with pip install 'adaptsim[cluster]'"
        ) from error
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterUnavailable(f"no Dask scheduler answers at {scheduler}: {error}") from error
    try:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError as error:
            raise ClusterUnavailable(f"the Dask cluster at {scheduler} has no worker: start one") from error
        try:
            yield _DaskExecutor(client)
        except RolloutError as error:
            # While a connection breaks, its futures may also fail with other errors.
            if client.status == "running":
                raise
            raise ClusterUnavailable(LOST) from error
    finally:
        client.close()


class _DaskExecutor(Executor):
    """Runs calls on a Dask client.

    If a worker dies while its result is on the way, this waits until another worker has computed it again. (The
    executor of `distributed` treats such a result as an error.)
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run `fn` on a worker. If the scheduler is lost, the future is cancelled."""
        remote = self._client.submit(fn, *args, pure=False, **kwargs)
        local: Future[Any] = Future()

        def hand_on(_: object) -> None:
            try:
                result = remote.result()
            except CancelledError:
                local.cancel()
                local.set_running_or_notify_cancel()
            except Exception as error:  # noqa: BLE001 - whatever the rollout raised
                if local.set_running_or_notify_cancel():
                    local.set_exception(error)
            else:
                if local.set_running_or_notify_cancel():
                    local.set_result(result)

        def cancel(_: object) -> None:
            if local.cancelled() and not remote.cancelled():
                remote.cancel()

        local.add_done_callback(cancel)
        remote.add_done_callback(hand_on)
        return local


def _serve() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
