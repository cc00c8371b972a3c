"""The dataset of a task: rollouts over parameters, actions, nuisance and, if it moves things, the context. It is drawn
once and used by all learning.

A folder holds `dataset.toml` (the settings, and probe rollouts that detect a changed scene) and shards. Shard i holds
rollouts from i*SHARD on of a scrambled Sobol sequence. So this part depends only on (task, seed, size). A larger
dataset extends a smaller one, and an interrupted run continues. A second part is denser where the outcome is uncertain:
its rows come from further along the same sequence, are chosen with the help of the first part, and are listed in
`denser.npz`.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.errors import DatasetError
from sim.rollouts.draws import physical_contexts, sobol
from sim.rollouts.run import Progress, Requests, Rollouts, concatenate, run_many
from sim.rollouts.shards import columns_digest, read_manifest, read_rollouts, simulate_missing, simulate_share, split
from sim.rollouts.shares import Share
from sim.storage.files import whole_file, write_toml
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

SHARD = 256
"""Rollouts per file. They take about half a minute of one core, which is the most that an interruption costs."""

MANIFEST = "dataset.toml"
DENSER = "denser.npz"

PROBE_TOLERANCE = 1e-3
"""Largest difference between normalised observations of a probe that counts as the same scene."""

POOL = 4
"""Candidates per added rollout."""

FLOOR = 0.02
"""Added to the variance of an outcome (at most 0.25), so that no region is left out."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """Rollouts without camera noise: parameters lie over the task's margin, actions over their space and the noise
    around it. The context is the reference, unless `Task.relocate` is None.
    """

    requests: Requests
    rollouts: Rollouts
    uniform: int  # how many of the first ones fill the space evenly; the others are denser somewhere

    def __len__(self) -> int:
        return len(self.rollouts)

    @property
    def identity(self) -> str:
        """A hash of everything except a context that all rollouts share."""
        same = bool((self.requests.context == self.requests.context[:1]).all())
        names = ("parameters", "action", "nuisance") if same else ("parameters", "context", "action", "nuisance")
        columns = {name: getattr(self.requests, name) for name in names}
        return columns_digest(columns | self.rollouts.columns)[:16]

    def select(self, rows: NDArray[np.intp]) -> tuple[Requests, Rollouts]:
        """The chosen rollouts."""
        return self.requests[rows], self.rollouts[rows]


@dataclass(frozen=True)
class AdaptiveSampling:
    """The number of added rollouts, and the rule for their places."""

    count: int
    variance: Callable[[Dataset, Requests], Array]
    """(first part, candidates (N,)) -> (N,) variance of the outcome of each, estimated from the first part."""


def choose(variance: Array, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """`count` rows, ascending, drawn in proportion to the `variance` (N,) of their outcome."""
    weight = variance + FLOOR
    return np.sort(rng.choice(len(variance), count, replace=False, p=weight / weight.sum()))


def dataset_requests(task: Task, seed: int, size: int) -> Requests:
    """The rollouts of the dataset (task, seed, size)."""
    return draw_requests(task, size, np.random.default_rng(seed))


def draw_requests(task: Task, size: int, rng: np.random.Generator) -> Requests:
    """Requests from a scrambled Sobol sequence over margin, action with noise, nuisance, and `physical_context`."""
    p, a, n = len(task.margin), len(task.action), len(task.nuisance)
    unit = sobol(size, p + a + n + len(task.physical_context), rng)
    low, high = task.action.low - task.action_noise, task.action.high + task.action_noise
    return Requests(
        parameters=task.margin.spread(unit[:, :p]),
        context=physical_contexts(task, unit[:, p + a + n :]),
        action=low + unit[:, p : p + a] * (high - low),
        nuisance=task.nuisance.spread(unit[:, p + a : p + a + n]),
    )


def build_dataset(
    task: Task,
    folder: Path,
    size: int,
    seed: int,
    executor: Executor,
    progress: Progress | None = None,
    denser: AdaptiveSampling | None = None,
) -> Dataset:
    """Simulate the missing rollouts in `folder` and return all: `size`, and those of the `denser` part.

    Raises DatasetError if the folder holds a dataset of another task, seed or scene.
    """
    more = 0 if denser is None else denser.count
    _agree_on_manifest(task, folder, size, more, seed, executor)
    even = _shards(folder, dataset_requests(task, seed, size), "shard")
    results = simulate_missing(task, even, executor, _offset(progress, 0, size + more))
    if denser is not None:
        added = _denser_shards(task, folder, size, seed, results, denser)
        simulate_missing(task, added, executor, _offset(progress, size, size + more))
    return load_dataset(folder, task)


def build_share(
    task: Task,
    folder: Path,
    size: int,
    seed: int,
    share: Share,
    executor: Executor,
    progress: Progress | None = None,
    denser: AdaptiveSampling | None = None,
) -> bool:
    """Simulate the missing rollouts of one share in `folder`; several processes may do so at a time.

    The `denser` part follows from the whole first part. Returns whether the share is complete: False while other shares
    of the first part are missing. Raises as `build_dataset`.
    """
    show = progress or (lambda done, total: None)
    _agree_on_manifest(task, folder, size, 0 if denser is None else denser.count, seed, executor)
    even = _shards(folder, dataset_requests(task, seed, size), "shard")
    simulate_share(task, even, share, executor, show)
    if denser is None:
        return True
    stored = [rows for path, part in even.items() if (rows := read_rollouts(path, part)) is not None]
    if len(stored) < len(even):
        return False
    simulate_share(task, _denser_shards(task, folder, size, seed, concatenate(stored), denser), share, executor, show)
    return True


def _denser_shards(
    task: Task, folder: Path, size: int, seed: int, results: Rollouts, denser: AdaptiveSampling
) -> dict[Path, Requests]:
    """The shards of the second part, whose places are chosen once by the `results` of the first."""
    pool = _pool(task, seed, size, denser.count)
    if not (folder / DENSER).exists():
        variance = denser.variance(Dataset(dataset_requests(task, seed, size), results, size), pool)
        rows = choose(variance, denser.count, np.random.default_rng([seed, size]))
        with suppress(FileExistsError), whole_file(folder / DENSER, replace=False) as temporary:  # the first share's
            np.savez(temporary, rows=rows)
    return _shards(folder, pool[_read_rows(folder / DENSER, denser.count, len(pool))], "denser")


def _pool(task: Task, seed: int, size: int, count: int) -> Requests:
    """The candidates of the denser part: the continuation of the first part's sequence."""
    return dataset_requests(task, seed, size + POOL * count)[size:]


def _shards(folder: Path, requests: Requests, kind: str) -> dict[Path, Requests]:
    return split(requests, SHARD, lambda number: folder / f"{kind}-{number:05d}.npz")


def _read_rows(path: Path, count: int, pool: int) -> NDArray[np.int64]:
    try:
        with np.load(path, allow_pickle=False) as file:
            rows = file["rows"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise DatasetError(f"{path} cannot be read ({error}): remove it, and the files {path.stem}-*.npz") from error
    if len(rows) != count or rows.min() < 0 or rows.max() >= pool:
        raise DatasetError(f"{path} lists {len(rows)} rollouts instead of {count}: use a new folder")
    return np.asarray(rows, dtype=np.int64)


def load_dataset(folder: Path, task: Task) -> Dataset:
    """The dataset in `folder`, every shard verified. Raises DatasetError."""
    manifest = _read_manifest(folder)
    if manifest is None:
        raise DatasetError(f"{folder} holds no dataset ({MANIFEST} is missing): build one with `adaptsim pretrain`")
    if manifest["interface"] != fingerprint(task):
        raise DatasetError(
            f"the dataset in {folder} was made for {manifest['task']} with other ranges "
            f"({manifest['interface']}, now {fingerprint(task)}): build one in a new folder"
        )
    size, more, seed = (int(manifest[key]) for key in ("size", "denser", "seed"))
    parts = [(dataset_requests(task, seed, size), "shard")]
    if more > 0:
        pool = _pool(task, seed, size, more)
        parts.append((pool[_read_rows(folder / DENSER, more, len(pool))], "denser"))
    requests = reduce(Requests.followed_by, (part for part, _ in parts))
    return Dataset(requests, concatenate(_loaded(folder, part, kind) for part, kind in parts), size)


def _loaded(folder: Path, requests: Requests, kind: str) -> Rollouts:
    parts = []
    for path, part in _shards(folder, requests, kind).items():
        rows = read_rollouts(path, part)
        if rows is None:
            raise DatasetError(
                f"{path} is missing, truncated or changed: run the same `adaptsim pretrain` again; it repeats only "
                "that shard"
            )
        parts.append(rows)
    return concatenate(parts)


def _agree_on_manifest(task: Task, folder: Path, size: int, more: int, seed: int, executor: Executor) -> None:
    """Write the manifest of a new dataset; compare an old one with the request and with the scene."""
    probe = run_many(task, _probe_requests(task), executor).observation
    manifest = _read_manifest(folder)
    if manifest is not None:
        for key, expected in (("task", task.name), ("interface", fingerprint(task)), ("seed", seed)):
            if manifest[key] != expected:
                raise DatasetError(
                    f"the dataset in {folder} has {key} = {manifest[key]}, wanted {expected}: use a new folder"
                )
        stored = np.asarray(manifest["probe"], dtype=np.float64)
        if stored.shape != probe.shape or np.abs(stored - probe).max() > PROBE_TOLERANCE:
            raise DatasetError(
                f"the scene of {task.name} has changed since the dataset in {folder} was begun (its probe rollouts end "
                "differently): use a new folder"
            )
        have = int(manifest["size"]), int(manifest["denser"])
        if (folder / DENSER).exists() and have != (size, more):
            raise DatasetError(
                f"the dataset in {folder} has {have[0]} rollouts and {have[1]} chosen by those; wanted "
                f"{size} and {more}: use a new folder"
            )
    plan = {"task": task.name, "interface": fingerprint(task), "seed": seed, "size": size, "denser": more}
    write_toml(folder / MANIFEST, {**plan, "probe": probe.tolist()})


def _probe_requests(task: Task) -> Requests:
    """Two rollouts, at one and two thirds of every range: enough to notice another scene."""
    third = np.array([[1 / 3], [2 / 3]])
    spaces = task.parameters, task.action, task.nuisance
    parameters, action, nuisance = (space.spread(np.tile(third, (1, len(space)))) for space in spaces)
    contexts = physical_contexts(task, np.tile(third, (1, len(task.physical_context))))
    return Requests(parameters, contexts, action, nuisance)


def _read_manifest(folder: Path) -> dict[str, Any] | None:
    keys = ("task", "interface", "seed", "size", "denser", "probe")
    return read_manifest(folder / MANIFEST, keys, "build it again")


def _offset(progress: Progress | None, start: int, total: int) -> Progress:
    return lambda done, _: None if progress is None else progress(start + done, total)
