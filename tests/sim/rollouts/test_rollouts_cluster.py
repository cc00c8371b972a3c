"""The same rollouts on two Dask workers of this computer, one of which is killed half-way."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import pytest
from distributed import Client
from toy_task import TOY, equal_rollouts

from sim.errors import ClusterUnavailable, RolloutError
from sim.rollouts import cluster
from sim.rollouts.cluster import dask_cluster
from sim.rollouts.dataset import dataset_requests
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import run_many

pytestmark = [
    pytest.mark.long,
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::UserWarning"),
]


@dataclass(frozen=True)
class Running:
    """A scheduler and its workers, each a process of its own, which no later test can wait for."""

    scheduler_address: str
    scheduler: subprocess.Popen[bytes]
    workers: tuple[subprocess.Popen[bytes], ...]


@contextmanager
def local_cluster(workers: int, threads: int = 1) -> Iterator[Running]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = started("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")
    others = [started("dask_worker", address, *WORKER, "--nthreads", str(threads)) for _ in range(workers)]
    try:
        with Client(address, timeout=60, set_as_default=False) as client:
            if workers:
                client.wait_for_workers(workers, timeout=60)
        yield Running(address, scheduler, tuple(others))
    finally:
        for process in (*others, scheduler):
            process.kill()
            process.wait()


WORKER = ("--no-nanny", "--no-dashboard", "--host", "127.0.0.1")


def started(program: str, *arguments: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}  # the toy task lies beside the tests
    command = [sys.executable, "-m", f"distributed.cli.{program}", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Running]:
    with local_cluster(2) as running:
        yield running


def test_a_killed_worker_loses_nothing_and_counts_nothing_twice():
    requests = dataset_requests(TOY, 3, 800)
    with serial_executor() as executor:
        expected = run_many(TOY, requests, executor)
    counts: list[int] = []
    with local_cluster(2) as running:

        def progress(done: int, total: int) -> None:
            counts.append(done)
            if done > total // 4:
                running.workers[0].kill()

        with dask_cluster(running.scheduler_address) as dask:
            rollouts = run_many(TOY, requests, dask, progress)
        assert running.workers[0].wait() == -signal.SIGKILL
    assert counts == sorted(counts)
    assert counts[-1] == 800
    assert equal_rollouts(rollouts, expected)


def _fails(parameters, context, action, nuisance, unmodelled=None):
    raise ZeroDivisionError("the scene fell apart")


def test_an_error_of_a_rollout_is_named_as_on_this_computer(two_workers):
    task = replace(TOY, simulate=_fails)
    with dask_cluster(two_workers.scheduler_address) as dask, pytest.raises(RolloutError, match="scene fell apart"):
        run_many(task, dataset_requests(TOY, 3, 8), dask)


def test_a_worker_with_other_versions_is_refused_by_name(two_workers, monkeypatch):
    here = {**cluster.versions(), "drake": "1.0.0"}
    monkeypatch.setattr(cluster, "versions", lambda: here)
    address = two_workers.scheduler_address
    with (
        pytest.raises(ClusterUnavailable, match=r"other versions.*: drake [\d.]+ \(here 1\.0\.0\)"),
        dask_cluster(address),
    ):
        pass


def test_a_worker_that_comes_later_with_other_versions_is_refused_too(two_workers, monkeypatch):
    here = {**cluster.versions(), "drake": "1.0.0"}
    with dask_cluster(two_workers.scheduler_address) as dask:
        monkeypatch.setattr(cluster, "versions", lambda: here)
        with pytest.raises(ClusterUnavailable, match=r"other versions.*: drake [\d.]+ \(here 1\.0\.0\)"):
            run_many(TOY, dataset_requests(TOY, 3, 8), dask)


ANOTHER_VERSION = """
from sim.rollouts import cluster
here = cluster.versions()
cluster.versions = lambda: {**here, "drake": "1.0.0"}
"""


def test_a_late_worker_with_other_versions_is_left_out_and_the_others_finish(two_workers, tmp_path):
    preload = tmp_path / "another_version.py"
    preload.write_text(ANOTHER_VERSION, encoding="utf-8")
    address, sentences = two_workers.scheduler_address, list[str]()
    requests = dataset_requests(TOY, 3, 800)
    with serial_executor() as executor:
        expected = run_many(TOY, requests, executor)
    with dask_cluster(address, sentences.append) as dask:
        late = started("dask_worker", address, *WORKER, "--nthreads", "1", "--preload", str(preload))
        try:
            with Client(address, set_as_default=False) as client:
                client.wait_for_workers(3, timeout=60)
            assert equal_rollouts(run_many(TOY, requests, dask), expected)
        finally:
            late.kill()
            late.wait()
    assert len(sentences) == 1 and "drake 1.0.0 (here" in sentences[0] and "left out" in sentences[0]


def test_a_cluster_that_is_slow_to_say_good_bye_spoils_no_result(two_workers, monkeypatch):
    close = Client.close

    def slow(client: Client, timeout: float) -> None:
        close(client)
        raise TimeoutError(f"timed out after {timeout} s")

    monkeypatch.setattr(Client, "close", slow)
    with dask_cluster(two_workers.scheduler_address) as dask:
        assert dask.submit(abs, -3).result(timeout=30) == 3


def test_calls_that_are_left_do_not_delay_those_of_the_next_connection(two_workers):
    for _ in range(3):
        with dask_cluster(two_workers.scheduler_address) as dask:
            for _ in range(8):
                dask.submit(time.sleep, 0.5)
    with dask_cluster(two_workers.scheduler_address) as dask:
        assert dask.submit(abs, -3).result(timeout=60) == 3


def test_a_worker_with_threads_is_refused():
    with (
        local_cluster(1, threads=2) as threaded,
        pytest.raises(ClusterUnavailable, match=r"has 2 threads.*--nthreads 1"),
        dask_cluster(threaded.scheduler_address),
    ):
        pass


def test_a_lost_scheduler_keeps_what_is_finished():
    with local_cluster(1) as lost:
        counts: list[int] = []

        def progress(done: int, total: int) -> None:
            counts.append(done)
            if len(counts) == 3:
                lost.scheduler.kill()

        with (
            pytest.raises(ClusterUnavailable, match="was lost: start it again"),
            dask_cluster(lost.scheduler_address) as dask,
        ):
            run_many(TOY, dataset_requests(TOY, 3, 80_000), dask, progress)
    assert 0 < counts[-1] < 80_000


def test_an_address_where_nobody_answers_gets_one_sentence(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.3)
    with (
        pytest.raises(ClusterUnavailable, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9: "),
        dask_cluster("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.parametrize("address", ["nonsense", "127.0.0.1", "ftp://127.0.0.1:80"])
def test_neither_does_anybody_at_an_address_that_is_none(address, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.3)
    with pytest.raises(ClusterUnavailable, match=f"no Dask scheduler answers at {address}"), dask_cluster(address):
        pass


WRONG_ADDRESSES = """
import gc
from distributed.utils import LoopRunner
from sim.errors import ClusterUnavailable
from sim.rollouts import cluster

def start_after_collection(runner, start=LoopRunner._start_unlocked):
    gc.collect()
    start(runner)

gc.disable()
cluster.CONNECT_S = 0.3
LoopRunner._start_unlocked = start_after_collection
for address in ("nonsense", "127.0.0.1", "ftp://127.0.0.1:80"):
    try:
        with cluster.dask_cluster(address):
            pass
    except ClusterUnavailable:
        print("refused")
"""


def test_an_address_after_a_wrong_one_is_asked_even_if_memory_is_collected_meanwhile():
    program = [sys.executable, "-c", WRONG_ADDRESSES]
    run = subprocess.run(program, capture_output=True, text=True, timeout=120, check=False)
    assert run.stdout.split() == ["refused"] * 3, run.stderr


def test_a_scheduler_without_workers_gets_the_line_that_starts_one(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with (
        local_cluster(0) as empty,
        pytest.raises(ClusterUnavailable, match=r"has no worker: dask worker tcp://127\.0\.0\.1:\d+ --nthreads 1"),
        dask_cluster(empty.scheduler_address),
    ):
        pass
