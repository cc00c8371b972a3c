"""The same rollouts on a real Dask cluster of this machine, with a worker killed half-way."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest
from distributed import LocalCluster
from toy_task import TOY, equal_rollouts

from sim.errors import ClusterUnavailable
from sim.rollouts import executors, run_many, serial_executor
from sim.rollouts.dataset import dataset_requests
from sim.rollouts.executors import dask_cluster

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::UserWarning")


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as made:
        yield made


def test_a_killed_worker_loses_nothing_and_counts_nothing_twice(cluster: LocalCluster) -> None:
    requests = dataset_requests(TOY, 3, 800)
    with serial_executor() as executor:
        expected = run_many(TOY, requests, executor)
    killed: list[int] = []
    counts: list[int] = []

    def progress(done: int, total: int) -> None:
        counts.append(done)
        if not killed and done > total // 4:
            killed.append(next(iter(cluster.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    with dask_cluster(cluster.scheduler_address) as dask:
        found = run_many(TOY, requests, dask, progress)
    assert killed
    assert counts == sorted(counts)
    assert counts[-1] == 800
    assert equal_rollouts(found, expected)


def test_a_lost_scheduler_says_so() -> None:
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as lost:

        def progress(done: int, total: int) -> None:
            lost.close()

        with pytest.raises(ClusterUnavailable, match="was lost"), dask_cluster(lost.scheduler_address) as executor:
            run_many(TOY, dataset_requests(TOY, 3, 8000), executor, progress)


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "CONNECT_S", 0.3)
    with pytest.raises(ClusterUnavailable, match="no Dask scheduler"), dask_cluster("tcp://127.0.0.1:9"):
        pass
