"""A cache of rollouts, so that an interrupted training continues without repeating simulations."""

from __future__ import annotations

import hashlib
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from sim.rollouts.run import Requests, Rollouts, run_many
from sim.rollouts.shards import read_rollouts, stored_count, write_rollouts
from sim.tasks.scene_key import scene_key
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class CachedRollouts:
    """A function requests -> rollouts, which reads from `folder` those simulated earlier in the same scene."""

    task: Task
    folder: Path
    executor: Executor

    def __call__(self, requests: Requests) -> Rollouts:
        """The rollouts of the requests, simulated or read. Raises RolloutError."""
        path = self.folder / f"{self._scene}-{_key(requests)}.npz"
        stored = read_rollouts(path, requests)
        if stored is not None:
            return stored
        results = run_many(self.task, requests, self.executor)
        write_rollouts(path, requests, results)
        return results

    def count(self) -> int:
        """Number of rollouts of this scene in the folder. Raises DatasetError on a damaged file."""
        return sum(stored_count(path) for path in sorted(self.folder.glob(f"{self._scene}-*.npz")))

    @cached_property
    def _scene(self) -> str:
        return scene_key(self.task)


def _key(requests: Requests) -> str:
    total = hashlib.sha256()
    for field in fields(requests):
        total.update(np.ascontiguousarray(getattr(requests, field.name)).tobytes())
    return total.hexdigest()[:24]
