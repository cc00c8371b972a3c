"""The workers of a Dask cluster as an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from platform import python_version_tuple
from threading import Lock
from typing import Any

from hw.extras import missing
from sim.errors import ClusterUnavailable, ExtraMissing

CONNECT_S = 15.0
"""How long a scheduler may take to answer, and to show its first worker."""

CLOSE_S = 5.0
"""How long a connection may take to close."""

RETRIES = 3
"""How often a call is repeated elsewhere after its worker died or the call failed."""

PACKAGES = ("adaptsim", "distributed", "drake", "mujoco", "numpy", "scipy")
"""The packages on whose versions the numbers of a rollout depend. The workers of a cluster must have the same versions.
"""

Warn = Callable[[str], None]
"""A function that gets a sentence about each worker that is left out."""


@contextmanager
def dask_cluster(scheduler: str, warn: Warn = lambda sentence: None) -> Iterator[Executor]:
    """The workers of a running Dask cluster, `scheduler` being its address, e.g. tcp://127.0.0.1:8786.

    If a worker is lost, the scheduler repeats its calls elsewhere, and each result is taken once. A worker that would
    compute other numbers is left out, whenever it joins, and is reported to `warn`. Raises ExtraMissing, and
    ClusterUnavailable if nobody answers there, no worker is up, or every worker would compute other numbers.
    """
    try:
        client = _connected_client(scheduler)
    except (OSError, ValueError) as error:
        raise ClusterUnavailable(f"no Dask scheduler answers at {scheduler}: {_brief(error)}") from error
    try:
        executor = _DaskExecutor(client, scheduler, _unlike_workers(client, scheduler), warn)
        try:
            yield executor
        finally:
            executor.shutdown()
    finally:
        with suppress(TimeoutError):  # results are there by now, and a busy or lost cluster may not say good-bye
            client.close(timeout=CLOSE_S)


def _connected_client(scheduler: str) -> Any:
    """A client of distributed, which `dask_cluster` closes. Raises ExtraMissing, and OSError or ValueError if nobody
    answers; the client is closed then.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ExtraMissing(missing("--scheduler", "distributed", "cluster")) from error

    class ExplicitlyClosedClient(Client):  # type: ignore[misc]
        """Garbage collection never closes it.

        The library's client closes itself there. If that happens while the next client starts, in the same thread,
        then closing waits for ever for the lock that starting holds.
        """

        def start(self, **timeouts: Any) -> None:
            try:
                super().start(**timeouts)
            except BaseException:
                self.close(timeout=CLOSE_S)
                raise

        def __del__(self) -> None:
            pass

    return ExplicitlyClosedClient(scheduler, timeout=CONNECT_S, set_as_default=False)


def _brief(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _unlike_workers(client: Any, scheduler: str) -> dict[str, str]:
    """The workers that would compute other numbers, each with its difference. Raises ClusterUnavailable if no worker
    is up, one has several threads, or none is left.
    """
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        raise ClusterUnavailable(
            f"the Dask scheduler at {scheduler} has no worker: dask worker {scheduler} --nthreads 1"
        ) from error
    for worker, facts in client.scheduler_info(n_workers=-1)["workers"].items():
        if facts["nthreads"] > 1:
            raise ClusterUnavailable(
                f"the worker {worker} has {facts['nthreads']} threads, and a rollout needs a process of its own: start "
                "it with --nthreads 1, and --nworkers for the number of processes"
            )
    unlike, workers = {}, client.get_versions(packages=PACKAGES)["workers"]
    for worker, facts in workers.items():
        installed = facts["packages"]
        python = ".".join(str(installed["python"]).split(".")[:2])
        remote = {"python": python, **{name: installed.get(name) for name in PACKAGES}}
        if difference := _difference(remote, versions()):
            unlike[worker] = difference
    if unlike and len(unlike) == len(workers):
        raise ClusterUnavailable(_sentence(*next(iter(unlike.items()))))
    return unlike


@cache
def versions() -> Mapping[str, str | None]:
    """The versions of Python and `PACKAGES` in this process; None for a package that is not installed."""
    here: dict[str, str | None] = {"python": ".".join(python_version_tuple()[:2])}
    for name in PACKAGES:
        try:
            here[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            here[name] = None
    return here


def _difference(remote: Mapping[str, str | None], here: Mapping[str, str | None]) -> str:
    """The packages of a worker that have other versions; empty if there are none."""
    return ", ".join(
        f"{name} {remote[name] or 'missing'} (here {here[name] or 'missing'})"
        for name in here
        if remote[name] != here[name]
    )


def _sentence(worker: str, difference: str) -> str:
    return (
        f"the worker {worker} has other versions, so its numbers may differ: {difference}. Install the same ones on "
        "every worker, then start it again"
    )


@dataclass(frozen=True)
class _Unlike:
    """The answer of a worker that would compute other numbers, in place of its result."""

    worker: str
    difference: str


def _on_worker(here: Mapping[str, str | None], call: Callable[..., Any], *arguments: Any) -> Any:
    """Runs on a worker, which may have joined later, and calls only if its versions are those of the program."""
    from distributed import get_worker  # noqa: PLC0415 - an extra

    difference = _difference(versions(), here)
    return _Unlike(get_worker().address, difference) if difference else call(*arguments)


class _DaskExecutor(Executor):
    """Runs calls on a Dask client.

    A worker may die while its result is on the way. Then `result` of the remote future waits for another worker, which
    the executor of `distributed` does not.
    """

    def __init__(self, client: Any, scheduler: str, unlike: Mapping[str, str], warn: Warn) -> None:
        self._client, self._scheduler, self._warn = client, scheduler, warn
        self._unlike: dict[str, str] = {}
        self._guard, self._handing_on, self._is_shut_down = Lock(), Lock(), False
        for worker, difference in unlike.items():
            self._leave_out(_Unlike(worker, difference))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run `fn` on a worker. The future fails with ClusterUnavailable if the scheduler is lost, or if every worker
        that is left would compute other numbers.
        """
        if kwargs:
            raise TypeError("a call on a cluster takes only positional arguments")
        local: Future[Any] = Future()
        self._send(local, fn, args)
        return local

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ask for no further result. A result that is on its way has `CLOSE_S` to arrive."""
        self._is_shut_down = True
        if wait and self._handing_on.acquire(timeout=CLOSE_S):
            self._handing_on.release()

    def _send(self, local: Future[Any], fn: Callable[..., Any], args: tuple[Any, ...]) -> None:
        if self._client.status != "running":
            local.set_exception(self._lost())
            return
        try:
            workers = self._alike()
        except ClusterUnavailable as error:
            local.set_exception(error)
            return
        remote = self._client.submit(
            _on_worker, versions(), fn, *args, pure=False, retries=RETRIES, workers=workers, allow_other_workers=False
        )

        def hand_on(_: object) -> None:
            with self._handing_on:  # one thread hands on all results; asking a closed client, it would wait for ever
                try:
                    if self._is_shut_down:
                        raise CancelledError
                    result = remote.result()
                except (CancelledError, Exception) as error:  # noqa: BLE001 - whatever the call raised
                    lost = isinstance(error, CancelledError) or self._client.status != "running"
                    if local.set_running_or_notify_cancel():
                        local.set_exception(self._lost() if lost else error)
                else:
                    if isinstance(result, _Unlike):
                        self._leave_out(result)
                        if not local.cancelled():
                            self._send(local, fn, args)
                    elif local.set_running_or_notify_cancel():
                        local.set_result(result)

        def cancel(_: object) -> None:
            if local.cancelled() and not remote.done():
                remote.cancel()

        local.add_done_callback(cancel)
        remote.add_done_callback(hand_on)

    def _leave_out(self, unlike: _Unlike) -> None:
        with self._guard:
            is_new = unlike.worker not in self._unlike
            self._unlike[unlike.worker] = unlike.difference
        if is_new:
            self._warn(f"{_sentence(unlike.worker, unlike.difference)}. It is left out")

    def _alike(self) -> list[str] | None:
        """The workers that compute the same numbers; None while all do. Raises ClusterUnavailable if none is left."""
        if not self._unlike:
            return None
        workers = self._client.scheduler_info(n_workers=-1)["workers"]
        alike = [worker for worker in workers if worker not in self._unlike]
        if not alike:
            raise ClusterUnavailable(_sentence(*next(iter(self._unlike.items()))))
        return alike

    def _lost(self) -> ClusterUnavailable:
        return ClusterUnavailable(f"the Dask scheduler at {self._scheduler} was lost: start it again")
