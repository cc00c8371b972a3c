"""World tables: true rollouts of a world, run once, so that sessions look up trials instead of simulating them.

If contexts differ only by `Task.relocate`, the result in a world depends only on the executed action; otherwise it also
depends on the context. So a table is a set of executed actions with their results, also in different contexts if these
move things. Half of the actions fill the action space; half are commands of policies of E at drawn contexts, with
offsets and action error. Rows with even numbers are for sessions and choices, rows with odd numbers for scores, so no
score uses a rollout that influenced a choice.

A table is a folder with `table.toml` (world, scene, policies) and shards with digests. An interrupted run can continue.
"""

from __future__ import annotations

import hashlib
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.errors import DatasetError
from sim.lab.drawn import as_toml
from sim.lab.rollout import task_in
from sim.lab.world import World
from sim.rollouts.draws import cover, physical_contexts, sobol
from sim.rollouts.run import Progress, Requests, Rollouts, concatenate
from sim.rollouts.shards import read_manifest, read_shard, simulate_missing, simulate_share, split
from sim.rollouts.shares import Share
from sim.storage.files import write_toml
from sim.tasks.task import Solver, Task

ROLLOUTS = 320
"""Rollouts per world. The 40 drawn worlds of a seed and the named ones need less than an hour of two cores per task."""

SHARD = 64

POLICIES = 32
"""Number of E, spread evenly over Omega; their policies command half of the actions."""

OFFSET = 0.08
"""Standard deviation of the offsets of these actions, in fractions of the ranges; every second action has no offset."""

MANIFEST = "table.toml"
FORMAT = 1
_MADE_OF = ("format", "task", "world", "scene", "size", "policies")


@dataclass(frozen=True, eq=False)
class WorldTable:
    """True rollouts of one world."""

    world: str
    requests: Requests  # with executed actions
    rollouts: Rollouts  # without camera noise
    digest: str

    @property
    def actions(self) -> Array:
        """(N, a) the executed actions, in units."""
        return self.requests.action

    def half(self, odd: bool) -> tuple[Requests, Rollouts]:
        """The odd rows, which are for scores, or the even rows, which are for everything else."""
        rows = slice(1 if odd else 0, None, 2)
        return self.requests[rows], self.rollouts[rows]


@dataclass(frozen=True, eq=False)
class PlannedTable:
    """The table of a world that is to be made, in a folder of its own."""

    solver: Solver
    policies: str
    """The digest of the checkpoint of `solver`, whose policies act in half of the rows."""
    scene: str
    """The task's `scene_key`."""
    world: World
    folder: Path
    size: int

    def build(self, executor: Executor, progress: Progress) -> WorldTable:
        """Simulate the missing rows, and return the whole table.

        Raises DatasetError if the folder holds another table, RolloutError, ClusterUnavailable.
        """
        plan = self._agreed()
        simulate_missing(task_in(self.world, self.solver.task), self._shards, executor, progress)
        table = _read(self.solver.task, self.folder, self.world, self.size)
        write_toml(self.folder / MANIFEST, {**plan, "digest": table.digest})
        return table

    def build_share(self, share: Share, before: int, executor: Executor, progress: Progress) -> tuple[int, int]:
        """Simulate the missing rows of one share of the table; several processes may do so at a time.

        `before` is the number of shards of earlier tables of the same work. Returns the number of shards of this share,
        and of the whole table. `build` joins the shares. Raises as it does.
        """
        self._agreed()
        shards = self._shards
        return simulate_share(task_in(self.world, self.solver.task), shards, share, executor, progress, before), len(
            shards
        )

    @property
    def _shards(self) -> dict[Path, Requests]:
        return split(table_requests(self.solver, self.world, self.size), SHARD, partial(_shard, self.folder))

    def _agreed(self) -> dict[str, Any]:
        """The conditions, stored in a new folder. Raises DatasetError if the folder holds another table."""
        plan = {
            "format": FORMAT,
            "task": self.solver.task.name,
            "world": world_digest(self.solver.task, self.world),
            "scene": self.scene,
            "size": self.size,
            "policies": self.policies,
        }
        before = _manifest(self.folder)
        if before is None:
            write_toml(self.folder / MANIFEST, {**plan, "digest": ""})
        elif different := [key for key in _MADE_OF if before.get(key) != plan[key]]:
            raise DatasetError(
                f"{self.folder} holds a table with a different {', '.join(different)}: remove it and run the same "
                "command again"
            )
        return plan


def load_table(task: Task, world: World, scene: str, folder: Path) -> WorldTable:
    """The finished table of `world` in `folder`. Raises DatasetError if there is none, or it is another table."""
    again = f"make it with `adaptsim world-tables --task {task.name} --targets {world.name}`"
    manifest = _manifest(folder)
    if manifest is None or not manifest["digest"]:
        raise DatasetError(f"there is no finished table of world {world.name} in {folder}: {again}")
    if (manifest["world"], manifest["scene"]) != (world_digest(task, world), scene):
        raise DatasetError(
            f"the table in {folder} is of another version of world {world.name}, or of another scene: remove the "
            f"folder, then {again}"
        )
    table = _read(task, folder, world, int(manifest["size"]))
    if table.digest != manifest["digest"]:
        raise DatasetError(f"the shards in {folder} are not those of {MANIFEST}: remove the folder, then {again}")
    return table


def table_requests(solver: Solver, world: World, size: int) -> Requests:
    """The rollouts of a table: a function of the world's name, the policies and the size."""
    task = solver.task
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(world.name.encode()).digest()[:8], "big"))
    a, evenly = len(task.action), size // 2
    low, high = task.action.low - task.action_noise, task.action.high + task.action_noise
    unit = sobol(evenly, a + len(task.physical_context), rng)
    filling = low + unit[:, :a] * (high - low)
    grid = cover(task.parameters, POLICIES, np.random.default_rng(0))
    policies = solver.policies(grid[:, None, :], np.random.default_rng(0))
    count = size - evenly
    contexts = task.context.sample(rng, count)
    commanded = np.stack([policies[i % POLICIES].actions(contexts[i : i + 1])[0] for i in range(count)])
    offset = OFFSET * rng.standard_normal((count, a)) * (rng.random((count, 1)) < 0.5)
    commanded = task.action.denormalise(np.clip(task.action.normalise(commanded) + offset, 0.0, 1.0))
    executed = commanded + rng.uniform(-1.0, 1.0, (count, a)) * task.action_noise
    order = rng.permutation(size)
    return Requests(
        parameters=np.tile(world.parameters, (size, 1)),
        context=np.concatenate([physical_contexts(task, unit[:, a:]), task.simulated_in(contexts)])[order],
        action=np.concatenate([filling, executed])[order],
        nuisance=np.tile(world.nuisance, (size, 1)),
    )


def world_digest(task: Task, world: World) -> str:
    """Sixteen hexadecimal digits: a digest of everything that determines a directly driven rollout in a world."""
    values = world.parameters.tobytes() + world.nuisance.tobytes()
    return hashlib.sha256(as_toml(task, world).encode() + values).hexdigest()[:16]


def _shard(folder: Path, number: int) -> Path:
    return folder / f"shard-{number:04d}.npz"


def _read(task: Task, folder: Path, world: World, size: int) -> WorldTable:
    """Read all shards, and verify each digest."""
    listed, parts, total = list[Requests](), list[Rollouts](), hashlib.sha256()
    for start in range(0, size, SHARD):
        path = _shard(folder, start // SHARD)
        contents = read_shard(path)
        if contents is None:
            raise DatasetError(f"{path} is missing or damaged: run `adaptsim world-tables` again, which makes it again")
        requests, results = contents
        listed.append(requests)
        parts.append(results)
        context = requests.context[:, : len(task.physical_context)]
        credit = [] if results.failure_reward is None else [results.failure_reward]
        for column in (requests.action, context, results.observation, results.end_state, results.succeeded, *credit):
            total.update(np.ascontiguousarray(column).tobytes())
    return WorldTable(world.name, reduce(Requests.followed_by, listed), concatenate(parts), total.hexdigest()[:16])


def _manifest(folder: Path) -> dict[str, Any] | None:
    return read_manifest(folder / MANIFEST, {*_MADE_OF, "digest"}, "make the table again")
