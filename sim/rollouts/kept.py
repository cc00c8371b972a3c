"""Rollouts that are simulated once and kept, one by one: in memory, and in a folder for the next process."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.rollouts.run import Progress, Requests, Rollouts, concatenate, run_parts
from sim.rollouts.shards import read_shard, write_rollouts
from sim.tasks.task import Task

PART = 32
"""Rollouts per file: at most these are lost in an interruption."""

OpenProgress = Callable[[int], AbstractContextManager[Progress]]
"""Number of rollouts -> where their progress is shown."""


def nowhere(rollouts: int) -> AbstractContextManager[Progress]:
    """Progress that is not shown."""
    return nullcontext(lambda done, total: None)


@dataclass(eq=False)
class KeptRollouts:
    """A `sim.rollouts.run.Roll` that simulates only new requests.

    Unlike `CachedRollouts` it finds each rollout by itself, whichever call asked for it first.
    """

    task: Task
    executor: Executor
    folder: Path | None = None  # None: in memory alone
    progress: OpenProgress = nowhere
    seconds: float = 0.0  # that a rollout takes on one core; 0: not measured
    simulated: int = 0  # by this object
    _places: dict[bytes, int] = field(default_factory=dict, repr=False)  # of a request, in `_rollouts`
    _rollouts: Rollouts | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.folder is not None:
            self.keep_in(self.folder)

    def keep_in(self, folder: Path) -> None:
        """Use the rollouts in the folder, and store new ones there."""
        self.folder = folder
        for path in sorted(folder.glob("*.npz")):
            if (contents := read_shard(path)) is not None:  # a damaged file is simulated again
                self._take(*contents)

    def __len__(self) -> int:
        """Number of rollouts that are kept."""
        return len(self._places)

    def knows(self, requests: Requests) -> NDArray[np.bool_]:
        """(N,) whether each of them is kept."""
        return np.array([key in self._places for key in _keys(requests)], dtype=bool)

    def __call__(self, requests: Requests) -> Rollouts:
        """The rollouts of the requests, in their order. Raises as `run_parts`."""
        keys = _keys(requests)
        first = {key: row for row, key in reversed(list(enumerate(keys)))}
        missing = sorted(row for key, row in first.items() if key not in self._places)
        if missing:
            self._simulate(requests[np.array(missing)])
        assert self._rollouts is not None, "a request is known or was simulated"
        return self._rollouts[np.array([self._places[key] for key in keys])]

    def _simulate(self, requests: Requests) -> None:
        """Simulate requests, and store each part once it is complete."""
        parts = [requests[start : start + PART] for start in range(0, len(requests), PART)]
        with self.progress(len(requests)) as progress:
            for part, rollouts in zip(parts, run_parts(self.task, parts, self.executor, progress), strict=True):
                self.simulated += len(part)
                if self.folder is not None:
                    name = hashlib.sha256(b"".join(_keys(part))).hexdigest()[:24]
                    write_rollouts(self.folder / f"{name}.npz", part, rollouts)
                self._take(part, rollouts)

    def _take(self, requests: Requests, rollouts: Rollouts) -> None:
        before = 0 if self._rollouts is None else len(self._rollouts)
        self._rollouts = rollouts if self._rollouts is None else concatenate([self._rollouts, rollouts])
        self._places |= {key: before + row for row, key in enumerate(_keys(requests))}


def _keys(requests: Requests) -> list[bytes]:
    rows = np.concatenate([getattr(requests, f.name) for f in fields(requests)], axis=1)
    return [row.tobytes() for row in np.ascontiguousarray(rows)]
