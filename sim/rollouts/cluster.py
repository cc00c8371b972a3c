"""The workers of a Dask cluster as an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from functools import cache
from importlib import metadata
from platform import python_version_tuple
from typing import Any

from sim.errors import ClusterUnavailable, ExtraMissing

CONNECT_S = 15.0
"""How long a scheduler may take to answer, and to show its first worker."""

RETRIES = 3
"""How often a call is repeated elsewhere after its worker died or the call failed."""

PACKAGES = ("adaptsim", "distributed", "drake", "mujoco", "numpy", "scipy", "torch")
"""The numbers of a rollout depend on these; a cluster has the versions of the program that asks it."""


@contextmanager
def dask_cluster(scheduler: str) -> Iterator[Executor]:
    """The workers of a running Dask cluster, `scheduler` being its address, e.g. tcp://127.0.0.1:8786.

    If a worker is lost, the scheduler repeats its calls elsewhere, and each result is taken once. Raises ExtraMissing,
    and ClusterUnavailable if nobody answers there, no worker is up, or a worker would compute other numbers.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ExtraMissing(
            "--scheduler needs the package distributed, which is not installed: pip install 'adaptsim[cluster]'"
        ) from error
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterUnavailable(f"no Dask scheduler answers at {scheduler}: {_brief(error)}") from error
    try:
        _require_alike_workers(client, scheduler)
        yield _DaskExecutor(client, scheduler)
    finally:
        with suppress(TimeoutError):  # results are there by now, and a busy or lost cluster may not say good-bye
            client.close(timeout=5)


def _brief(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _require_alike_workers(client: Any, scheduler: str) -> None:
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
    for worker, facts in client.get_versions(packages=PACKAGES)["workers"].items():
        installed = facts["packages"]
        python = ".".join(str(installed["python"]).split(".")[:2])
        _require_versions(worker, {"python": python, **{name: installed.get(name) for name in PACKAGES}}, versions())


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


def _require_versions(worker: str, remote: Mapping[str, str | None], here: Mapping[str, str | None]) -> None:
    different = [
        f"{name} {remote[name] or 'missing'} (here {here[name] or 'missing'})"
        for name in here
        if remote[name] != here[name]
    ]
    if different:
        raise ClusterUnavailable(
            f"the worker {worker} has other versions, so its numbers may differ: {', '.join(different)}. Install the "
            "same ones on every worker, then start it again"
        )


def _on_worker(here: Mapping[str, str | None], call: Callable[..., Any], *arguments: Any) -> Any:
    """On a worker, which may have come after the others: call once its versions are those of the program."""
    from distributed import get_worker  # noqa: PLC0415 - an extra

    _require_versions(get_worker().address, versions(), here)
    return call(*arguments)


class _DaskExecutor(Executor):
    """Runs calls on a Dask client.

    A worker may die while its result is on the way. Then `result` of the remote future waits for another worker, which
    the executor of `distributed` does not.
    """

    def __init__(self, client: Any, scheduler: str) -> None:
        self._client, self._scheduler = client, scheduler

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run `fn` on a worker. The future fails with ClusterUnavailable if the scheduler is lost."""
        if kwargs:
            raise TypeError("a call on a cluster takes positional arguments alone")
        local: Future[Any] = Future()
        if self._client.status != "running":
            local.set_exception(self._lost())
            return local
        remote = self._client.submit(_on_worker, versions(), fn, *args, pure=False, retries=RETRIES)

        def hand_on(_: object) -> None:
            try:
                result = remote.result()
            except (CancelledError, Exception) as error:  # noqa: BLE001 - whatever the call raised
                lost = isinstance(error, CancelledError) or self._client.status != "running"
                if local.set_running_or_notify_cancel():
                    local.set_exception(self._lost() if lost else error)
            else:
                if local.set_running_or_notify_cancel():
                    local.set_result(result)

        def cancel(_: object) -> None:
            if local.cancelled() and not remote.done():
                remote.cancel()

        local.add_done_callback(cancel)
        remote.add_done_callback(hand_on)
        return local

    def _lost(self) -> ClusterUnavailable:
        return ClusterUnavailable(f"the Dask scheduler at {self._scheduler} was lost: start it again")
