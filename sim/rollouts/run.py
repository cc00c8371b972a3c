"""Many rollouts on an Executor: the same results for any number of workers and any order."""

from __future__ import annotations

import gc
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, fields
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.errors import ClusterUnavailable, RolloutError, SimError, TaskError
from sim.tasks.task import SimulateMany, Task
from sim.types import PredictedOutcomes

OUTCOMES: tuple[Outcome, ...] = tuple(Outcome)
"""`Rollouts.outcome` holds indices into this tuple."""

CHUNK, CALLS = 8, 16
"""The most rollouts per call of a worker. They are half a second of work, so that little is repeated after a crash.

There are fewer per call if there would be less than this many calls, so that even the two trials of a session's step
keep two workers busy."""

IN_FLIGHT = 4096
"""Chunks of under 2 KB in the executor's queue at a time. They are enough for a thousand workers, and bound the queue.
"""

Progress = Callable[[int, int], None]
"""(rollouts so far, all)"""

StageProgress = Callable[[str, int, int], None]
"""(stage, parts of it so far, all)"""


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

    @classmethod
    def broadcast(
        cls, parameters: Array, context: Array, action: Array, nuisance: Array
    ) -> tuple[Requests, tuple[int, ...]]:
        """(..., p), (..., c), (..., a), (..., n) -> a row for each element of their common leading shape, and this
        shape.
        """
        values = (parameters, context, action, nuisance)
        lead = np.broadcast_shapes(*(value.shape[:-1] for value in values))
        rows = (np.broadcast_to(v, (*lead, v.shape[-1])).reshape(math.prod(lead), v.shape[-1]) for v in values)
        return cls(*rows), lead

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
    failure_reward: Array | None = None  # (N,) of failures; None: in this task they earn nothing

    def __post_init__(self) -> None:
        for column in self.columns.values():
            column.flags.writeable = False

    def __len__(self) -> int:
        return len(self.succeeded)

    def __getitem__(self, index: slice | NDArray[np.int64]) -> Rollouts:
        return Rollouts(**{name: column[index] for name, column in self.columns.items()})

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Name -> array, without what this task does not give."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: column for name, column in named.items() if column is not None}

    def rewards(self, task: Task, context: Array) -> Array:
        """(N,) rewards of the rollouts if scored at `context` (N, c)."""
        failed = 0.0 if self.failure_reward is None else self.failure_reward
        return np.where(self.succeeded, task.reward_of_success(self.successful_ends, context), failed)

    @property
    def successful_ends(self) -> Array:
        """(N, k) the end states, 0 for a failure."""
        return np.where(self.succeeded[:, None], self.end_state, 0.0)

    def outcomes(self, shape: tuple[int, ...]) -> PredictedOutcomes:
        """The rollouts as predictions that are certain, with the leading axes `shape`."""
        failed = None if self.failure_reward is None else self.failure_reward.reshape(shape)
        ends = self.successful_ends.reshape(*shape, -1)
        return PredictedOutcomes(self.succeeded.astype(np.float64).reshape(shape), ends, failed)

    def ends(self) -> tuple[Array | None, ...]:
        """The end state (k,) of each success; None for a failure."""
        return tuple(end if good else None for end, good in zip(self.end_state, self.succeeded, strict=True))


Roll = Callable[[Requests], Rollouts]
"""A source of rollouts: true ones (`run_many` on some executor, or from a folder), or those of an emulator."""


def concatenate(parts: Iterable[Rollouts]) -> Rollouts:
    """All rollouts as one, in the order of the parts."""
    rows = list(parts)
    return Rollouts(**{name: np.concatenate([r.columns[name] for r in rows]) for name in rows[0].columns})


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
    """The rollouts of all requests, in their order. Raises the same errors as `run_parts`."""
    (rollouts,) = run_parts(task, [requests], executor, progress)
    return rollouts


def run_parts(
    task: Task, parts: Sequence[Requests], executor: Executor, progress: Progress | None = None
) -> Iterator[Rollouts]:
    """Simulate several parts, and yield the rollouts of each, in their order.

    Workers that have nothing left to do in a part work on the next ones, so no part waits for the last chunk of
    another. `progress` counts the rollouts of all parts.

    Raises RolloutError naming the running requests if a rollout raises or a worker dies, ClusterUnavailable if the
    scheduler of a cluster is lost, TaskError if the code of a task's file fails. The caller keeps the executor.
    A task that simulates stacks does so in this process, which is quicker than using the executor.
    """
    if not all(map(len, parts)):
        raise ValueError("no requests were given")
    simulate, total = task.simulate_many, sum(map(len, parts))
    if simulate is not None:
        return _stacked(task, simulate, parts, total, progress or _silent)
    return _spread(task, parts, total, executor, progress or _silent)


@dataclass(frozen=True)
class _Chunk:
    """Requests from `start` to `end` of a part."""

    part: int
    start: int
    end: int


def _stacked(
    task: Task, simulate: SimulateMany, parts: Sequence[Requests], total: int, progress: Progress
) -> Iterator[Rollouts]:
    done = 0
    for number, part in enumerate(parts):
        try:
            rollouts = observed(task, simulate(part.parameters, part.context, part.action, part.nuisance))
        except SimError:
            raise
        except Exception as error:  # a task of another package may raise anything
            raise _failure(parts, [_Chunk(number, 0, len(part))], error) from error
        yield rollouts
        done += len(part)
        progress(done, total)


def _spread(
    task: Task, parts: Sequence[Requests], total: int, executor: Executor, progress: Progress
) -> Iterator[Rollouts]:
    waiting, running, done = _chunks(parts), dict[Future[Rollouts], _Chunk](), 0
    arrivals, arrived = SimpleQueue[Future[Rollouts]](), list[Future[Rollouts]]()
    finished: list[dict[int, Rollouts]] = [{} for _ in parts]
    missing = [len(part) for part in parts]
    try:
        for number in range(len(parts)):
            while missing[number]:
                for chunk in itertools.islice(waiting, IN_FLIGHT - len(running)):
                    try:
                        future = executor.submit(_run_chunk, task, parts[chunk.part][chunk.start : chunk.end])
                    except BrokenExecutor as broken:
                        raise _failure(parts, [chunk], broken) from broken
                    running[future] = chunk
                    future.add_done_callback(arrivals.put)
                if not arrived:
                    arrived.append(arrivals.get())
                arrived.extend(arrivals.get_nowait() for _ in range(arrivals.qsize()))
                arrived.sort(key=lambda f: (running[f].part, running[f].start), reverse=True)
                while arrived and missing[number]:  # a finished part is handed on before anything that fails later
                    future = arrived.pop()
                    rollouts = _result(parts, running, future)
                    chunk = running.pop(future)
                    finished[chunk.part][chunk.start] = rollouts
                    missing[chunk.part] -= len(rollouts)
                    done += len(rollouts)
                progress(done, total)
            chunks = finished[number]
            yield concatenate(chunks[start] for start in sorted(chunks))
            chunks.clear()
    finally:
        for future in running:
            future.cancel()


def _chunks(parts: Sequence[Requests]) -> Iterator[_Chunk]:
    for number, part in enumerate(parts):
        size = max(1, min(CHUNK, len(part) // CALLS))
        for start in range(0, len(part), size):
            yield _Chunk(number, start, min(start + size, len(part)))


def _result(
    parts: Sequence[Requests], running: Mapping[Future[Rollouts], _Chunk], future: Future[Rollouts]
) -> Rollouts:
    """The rollouts of a future that is done."""
    error = future.exception()
    if isinstance(error, (ClusterUnavailable, TaskError)):
        raise error
    if error is not None:
        chunk = running[future]
        lost = [other for other in running.values() if other.part == chunk.part]
        lost.sort(key=lambda other: other.start)
        raise _failure(parts, lost if isinstance(error, BrokenExecutor) else [chunk], error) from error
    return future.result()


def _silent(done: int, total: int) -> None:
    """Show no progress."""


def _run_chunk(task: Task, requests: Requests) -> Rollouts:
    """Simulate a few requests, in a worker."""
    tracks = [
        task.simulate(p, c, a, n)
        for p, c, a, n in zip(requests.parameters, requests.context, requests.action, requests.nuisance, strict=True)
    ]
    gc.collect(1)  # young objects only, 3 ms: plants and diagrams refer to each other and would accumulate
    return observed(task, tracks)


def observed(task: Task, tracks: Sequence[ObjectTrack]) -> Rollouts:
    """The stored part of the tracks."""
    succeeded = np.array([bool(task.succeeded(track)) for track in tracks])
    failed = None
    if task.reward_of_failure is not None:
        pairs = zip(tracks, succeeded, strict=True)
        failed = np.array([0.0 if good else task.failure_reward(track) for track, good in pairs])
    return Rollouts(
        observation=np.stack([task.observation(track) for track in tracks]),
        end_state=np.stack([np.atleast_1d(task.end_state(track)).astype(np.float64) for track in tracks]),
        succeeded=succeeded,
        outcome=np.array([OUTCOMES.index(track.outcome) for track in tracks], dtype=np.int8),
        failure_reward=failed,
    )


def _failure(parts: Sequence[Requests], lost: Sequence[_Chunk], error: BaseException) -> RolloutError:
    """Name the `lost` chunks of a part: the one that raised, or all that may have killed the process."""
    requests, first = parts[lost[0].part], lost[0].start
    spans = [f"{c.start}-{c.end - 1}" if c.end - c.start > 1 else str(c.start) for c in lost]
    which = ", ".join(spans[:4]) + (" ..." if len(spans) > 4 else "")
    what = "a worker died" if isinstance(error, BrokenExecutor) else f"{type(error).__name__}: {error}"
    return RolloutError(
        f"rollouts {which} of {len(requests)} failed ({what}); the first has parameters {requests.parameters[first]}, "
        f"context {requests.context[first]}, action {requests.action[first]}, nuisance {requests.nuisance[first]}. "
        "Run it by itself to see why."
    )
