"""Rollouts in a file, with a digest that reveals damage."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Executor
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hw.bounded import Unreadable
from sim.errors import DatasetError
from sim.rollouts.run import Progress, Requests, Rollouts, concatenate, run_many, run_parts
from sim.rollouts.shares import Share
from sim.storage.files import read_toml, whole_file
from sim.tasks.fingerprint import scene_key
from sim.tasks.task import Task

_REQUEST_FIELDS = tuple(f.name for f in fields(Requests))
_RESULT_FIELDS = tuple(f.name for f in fields(Rollouts) if f.default is MISSING)
_OPTIONAL_FIELDS = tuple(f.name for f in fields(Rollouts) if f.default is not MISSING)


def read_manifest(path: Path, keys: Collection[str], again: str) -> dict[str, Any] | None:
    """The manifest `path` of a folder of shards, with all `keys`; None if there is none.

    Raises DatasetError; its message ends with `again`, the way to get another one.
    """
    if not path.exists():
        return None
    try:
        manifest = read_toml(path)
    except Unreadable as error:
        raise DatasetError(f"{path} {error}: remove the folder and {again}") from error
    if missing := set(keys) - manifest.keys():
        raise DatasetError(f"{path} has no {', '.join(sorted(missing))}: remove the folder and {again}")
    return manifest


def columns_digest(columns: dict[str, Any]) -> str:
    """A digest of named arrays, independent of their order."""
    total = hashlib.sha256()
    for name in sorted(columns):
        total.update(name.encode() + np.ascontiguousarray(columns[name]).tobytes())
    return total.hexdigest()


def write_rollouts(path: Path, requests: Requests, results: Rollouts) -> None:
    """Write one shard, whole or not at all, with a digest that `read_rollouts` checks."""
    columns = {name: getattr(requests, name) for name in _REQUEST_FIELDS}
    columns |= results.columns
    digest = np.frombuffer(bytes.fromhex(columns_digest(columns)), dtype=np.uint8)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, digest=digest, **columns)


def read_rollouts(path: Path, requests: Requests) -> Rollouts | None:
    """The results in a shard, or None if it is missing, damaged, or for other requests."""
    contents = read_shard(path)
    if contents is None:
        return None
    stored, results = contents
    same = all(np.array_equal(getattr(stored, name), getattr(requests, name)) for name in _REQUEST_FIELDS)
    return results if same else None


def read_shard(path: Path) -> tuple[Requests, Rollouts] | None:
    """The contents of a shard, or None if it is missing or damaged."""
    if not path.exists():
        return None
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            optional = [name for name in _OPTIONAL_FIELDS if name in file]
            columns = {name: file[name] for name in (*_REQUEST_FIELDS, *_RESULT_FIELDS, *optional)}
            digest = file["digest"].tobytes().hex()
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    if digest != columns_digest(columns):
        return None
    requests = {name: columns.pop(name) for name in _REQUEST_FIELDS}
    return Requests(**requests), Rollouts(**columns)


def split(requests: Requests, size: int, path_of: Callable[[int], Path]) -> dict[Path, Requests]:
    """Path -> requests of a shard: the requests in shards of at most `size`, whose numbers give the paths."""
    return {path_of(start // size): requests[start : start + size] for start in range(0, len(requests), size)}


def simulate_missing(task: Task, shards: Mapping[Path, Requests], executor: Executor, progress: Progress) -> Rollouts:
    """All rollouts of `shards`, in their order; missing and damaged ones are simulated and stored.

    `progress` counts the stored ones too. Raises as `run_parts`.
    """
    by_path = {path: read_rollouts(path, part) for path, part in shards.items()}
    missing = {path: part for path, part in shards.items() if by_path[path] is None}
    total = sum(map(len, shards.values()))
    stored = total - sum(map(len, missing.values()))
    progress(stored, total)
    simulated = run_parts(task, list(missing.values()), executor, lambda done, _: progress(stored + done, total))
    for path, rollouts in zip(missing, simulated, strict=True):
        write_rollouts(path, missing[path], rollouts)
        by_path[path] = rollouts
    return concatenate(rollouts for rollouts in by_path.values() if rollouts is not None)


def simulate_share(
    task: Task, shards: Mapping[Path, Requests], share: Share, executor: Executor, progress: Progress, before: int = 0
) -> int:
    """Simulate the missing shards of one share, and return the number of its shards.

    `before` is the number of shards of the same work that precede these. Raises as `run_parts`.
    """
    mine = dict(share.of(list(shards.items()), before))
    if mine:
        simulate_missing(task, mine, executor, progress)
    return len(mine)


def stored_count(path: Path) -> int:
    """The number of rollouts in a shard. Raises DatasetError if it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return len(file["succeeded"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise DatasetError(f"{path} is damaged ({error}): remove it; its rollouts are then simulated again") from error


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
