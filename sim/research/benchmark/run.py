"""Runs all jobs of a benchmark on an executor. Each result is a file of its own, so an interrupted run can continue."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from sim.errors import DatasetError, RolloutError
from sim.research.benchmark.jobs import BenchmarkRow, Job
from sim.rollouts.run import Progress
from sim.storage.files import read_toml, whole_file, write_toml

PLAN = "benchmark.toml"
IN_FLIGHT = 64
"""Jobs in the executor's queue at a time."""


@dataclass(frozen=True)
class Results:
    """The folder of a benchmark; `benchmark.toml` states the conditions of its rows."""

    folder: Path

    def agree(self, plan: dict[str, Any]) -> None:
        """Store the conditions. Raises DatasetError if the folder holds results with other conditions."""
        path = self.folder / PLAN
        if not path.exists():
            write_toml(path, plan)
            return
        before = read_toml(path)
        if different := [key for key, value in plan.items() if before.get(key) != value]:
            raise DatasetError(
                f"{self.folder} holds results with a different {', '.join(different)}: give another --out"
            )

    def row(self, job: Job) -> BenchmarkRow | None:
        """The stored row of a job; None if there is none or it is unreadable, so that the job runs again."""
        try:
            stored = json.loads(self._path(job).read_text(encoding="utf-8"))
            if stored.keys() != {field.name for field in fields(BenchmarkRow)}:
                return None
            ci95, curve = tuple(stored["ci95"]), tuple((int(n), float(r)) for n, r in stored["curve"])
            return BenchmarkRow(**{**stored, "ci95": ci95, "curve": curve})
        except (OSError, ValueError, TypeError):
            return None

    def keep(self, job: Job, row: BenchmarkRow) -> None:
        """Store the row of a job, whole or not at all."""
        with whole_file(self._path(job)) as temporary:
            temporary.write_text(json.dumps(asdict(row), allow_nan=False) + "\n", encoding="utf-8")

    def _path(self, job: Job) -> Path:
        return self.folder / "rows" / job.set / f"{job.target}-{job.answers}" / f"{job.method}-{job.seed}.json"


def run_jobs(
    jobs: Sequence[Job],
    results: Results,
    executor: Executor,
    progress: Progress,
    run: Callable[[Job], BenchmarkRow],
) -> list[BenchmarkRow]:
    """The rows of all jobs, in order; stored ones are not run again. `run` can be sent to a worker.

    Raises the errors of a job, RolloutError if a worker died, ClusterUnavailable.
    """
    rows = {i: row for i, job in enumerate(jobs) if (row := results.row(job)) is not None}
    missing = iter([i for i in range(len(jobs)) if i not in rows])
    running: dict[Future[BenchmarkRow], int] = {}
    progress(len(rows), len(jobs))
    try:
        while len(rows) < len(jobs):
            for i in itertools.islice(missing, IN_FLIGHT - len(running)):
                running[executor.submit(run, jobs[i])] = i
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in sorted(ready, key=_failed):
                i = running.pop(future)
                rows[i] = future.result()
                results.keep(jobs[i], rows[i])
                progress(len(rows), len(jobs))
    except BrokenExecutor as error:
        raise RolloutError("a worker died; the same command continues from there") from error
    finally:
        for future in running:
            future.cancel()
    return [rows[i] for i in range(len(jobs))]


def _failed(future: Future[BenchmarkRow]) -> bool:
    """The key for sorting: failed jobs come last, so that the results of the others are stored."""
    return future.exception() is not None
