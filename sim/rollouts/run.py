"""Many rollouts on an Executor: the same results for any number of workers and any order."""

from __future__ import annotations

import gc
import itertools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.errors import ClusterUnavailable, RolloutError, UnknownName
from sim.rollouts.executors import LOST
from sim.tasks import get_task
from sim.tasks.task import Task

OUTCOMES: tuple[Outcome, ...] = tuple(Outcome)
"""`Rollouts.outcome` holds indices into this tuple."""

CHUNK, CALLS = 8, 16
"""Most rollouts per call of a worker: half a second of work, so that little is repeated after a crash.

Fewer if that gives less than this many calls, so that even the two trials of a session's step keep two workers busy.
"""

IN_FLIGHT = 64
"""Chunks in the executor's queue at a time, so that a large request does not fill it."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Requests:
    """The inputs of rollouts, in units; row i of each array belongs to rollout i."""

    parameters: Array  # (N, p)
    context: Array  # (N, c)
    action: Array  # (N, a) as executed
    nuisance: Array  # (N, n)

    def __post_init__(self) -> None:
        n = len(self.parameters)
        for field in fields(self):
            object.__setattr__(self, field.name, frozen_array(getattr(self, field.name), (n, None), field.name))

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, index: slice | NDArray[np.int64]) -> Requests:
        return Requests(*(getattr(self, field.name)[index] for field in fields(self)))

    def followed_by(self, other: Requests) -> Requests:
        """These requests, then the other ones."""
        return Requests(*(np.concatenate([getattr(r, f.name) for r in (self, other)]) for f in fields(Requests)))


@dataclass(frozen=True, eq=False)
class Rollouts:
    """The results of rollouts."""

    observation: Array  # (N, size) normalised, without camera noise
    end_state: Array  # (N, k); not a number where there is none
    succeeded: NDArray[np.bool_]  # (N,)
    outcome: NDArray[np.int8]  # (N,) index into OUTCOMES

    def __post_init__(self) -> None:
        for field in fields(self):
            getattr(self, field.name).flags.writeable = False

    def __len__(self) -> int:
        return len(self.succeeded)

    def __getitem__(self, index: slice | NDArray[np.int64]) -> Rollouts:
        return Rollouts(*(getattr(self, field.name)[index] for field in fields(self)))

    def rewards(self, task: Task, context: Array) -> Array:
        """(N,) rewards of the rollouts if scored at `context` (N, c)."""
        end = np.where(self.succeeded[:, None], self.end_state, 0.0)
        return np.where(self.succeeded, task.reward_of_success(end, context), 0.0)

    def ends(self) -> tuple[Array | None, ...]:
        """The end state (k,) of each success; None for a failure."""
        return tuple(end if good else None for end, good in zip(self.end_state, self.succeeded, strict=True))


Roll = Callable[[Requests], Rollouts]
"""A source of rollouts: true ones (`run_many` on some executor, or from a folder), or those of an emulator."""


def concatenate(parts: Iterable[Rollouts]) -> Rollouts:
    """All rollouts as one, in the order of the parts."""
    rows = list(parts)
    return Rollouts(*(np.concatenate([getattr(r, f.name) for r in rows]) for f in fields(Rollouts)))


def roll_in_parts(roll: Roll, size: int, total: int, progress: Progress) -> Roll:
    """`roll` in parts of at most `size`; after each part, `progress` gets the number done and `total`."""
    done = 0

    def in_parts(requests: Requests) -> Rollouts:
        nonlocal done
        parts = []
        for start in range(0, len(requests), size):
            parts.append(roll(requests[start : start + size]))
            done += len(parts[-1])
            progress(min(done, total), total)
        return concatenate(parts)

    return in_parts


def run_many(task: Task, requests: Requests, executor: Executor, progress: Progress | None = None) -> Rollouts:
    """Simulate every request, in their order.

    Raises RolloutError naming the running requests if a rollout raises or a worker dies. Raises ClusterUnavailable if a
    cluster's scheduler is gone. The caller keeps the executor. A task that simulates stacks does so in this process,
    which is quicker than using the executor.
    """
    if len(requests) == 0:
        raise ValueError("run_many was given no requests")
    if task.simulate_many is not None:
        results = _observed(
            task, task.simulate_many(requests.parameters, requests.context, requests.action, requests.nuisance)
        )
        if progress is not None:
            progress(len(requests), len(requests))
        return results
    source = _reference(task)
    chunk = max(1, min(CHUNK, len(requests) // CALLS))
    starts = iter(range(0, len(requests), chunk))
    running: dict[Future[Rollouts], int] = {}
    done: dict[int, Rollouts] = {}
    try:
        while len(done) * chunk < len(requests):
            for start in itertools.islice(starts, IN_FLIGHT - len(running)):
                try:
                    running[executor.submit(_run_chunk, source, requests[start : start + chunk])] = start
                except BrokenExecutor as broken:
                    raise _failure(requests, [start], chunk, broken) from broken
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in sorted(ready, key=lambda f: running[f]):
                if future.cancelled():
                    raise ClusterUnavailable(LOST)
                error = future.exception()
                if error is not None:
                    lost = sorted(running.values()) if isinstance(error, BrokenExecutor) else [running[future]]
                    raise _failure(requests, lost, chunk, error) from error
                done[running.pop(future)] = future.result()
            if progress is not None:
                progress(sum(map(len, done.values())), len(requests))
    finally:
        for future in running:
            future.cancel()
    return concatenate(done[start] for start in sorted(done))


def _run_chunk(source: str | Task, requests: Requests) -> Rollouts:
    """In a worker: simulate a few requests."""
    task = _resolve(source)
    tracks = [
        task.simulate(p, c, a, n)
        for p, c, a, n in zip(requests.parameters, requests.context, requests.action, requests.nuisance, strict=True)
    ]
    gc.collect(1)  # young objects only, 3 ms: plants and diagrams refer to each other and would accumulate
    return _observed(task, tracks)


def _observed(task: Task, tracks: Sequence[ObjectTrack]) -> Rollouts:
    """The stored part of the tracks."""
    return Rollouts(
        observation=np.stack([task.observation(track) for track in tracks]),
        end_state=np.stack([np.atleast_1d(task.end_state(track)).astype(np.float64) for track in tracks]),
        succeeded=np.array([bool(task.succeeded(track)) for track in tracks]),
        outcome=np.array([OUTCOMES.index(track.outcome) for track in tracks], dtype=np.int8),
    )


def _reference(task: Task) -> str | Task:
    """The name of a registered task, which a fresh process can look up; any other task itself."""
    try:
        return task.name if get_task(task.name) is task else task
    except UnknownName:
        return task


def _resolve(source: str | Task) -> Task:
    if not isinstance(source, str):
        return source
    return get_task(source)


def _failure(requests: Requests, lost: list[int], chunk: int, error: BaseException) -> RolloutError:
    """Name the `lost` calls: the one that raised, or all calls that may have killed the process."""
    ends = [min(start + chunk, len(requests)) - 1 for start in lost]
    spans = [f"{start}-{end}" if end > start else str(start) for start, end in zip(lost, ends, strict=True)]
    which = ", ".join(spans[:4]) + (" ..." if len(spans) > 4 else "")
    first = requests[lost[0] : lost[0] + 1]
    what = "a worker died" if isinstance(error, BrokenExecutor) else f"{type(error).__name__}: {error}"
    return RolloutError(
        f"rollouts {which} of {len(requests)} failed ({what}); the first has parameters {first.parameters[0]}, "
        f"context {first.context[0]}, action {first.action[0]}, nuisance {first.nuisance[0]}. Run it by itself to see "
        "why."
    )
