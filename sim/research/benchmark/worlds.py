"""The worlds of a benchmark by name.

`develop` and `drawn` are forty worlds each, drawn by `sim.lab.drawn`; none was dropped. Methods are developed on
`develop`; `drawn` is for reported results. `drawn-3` are those of another seed. `named` are the shipped worlds.
`foods` are forty pieces of food for scooping, drawn by `sim.lab.foods`. `mujoco` are the shipped worlds with a physics
that training does not use. Any other name is that of one world, drawn ones included (`drawn-2-0`, `foods-5-0`), or of
a file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sim.errors import UnknownName
from sim.lab.drawn import drawn_world
from sim.lab.foods import food_world
from sim.lab.world import World, list_worlds, load_world, shipped_worlds
from sim.tasks.task import Task

DRAWN = 40
DEVELOP_SEED, REPORT_SEED, FOODS_SEED = 0, 2, 5
DEVELOP, REPORT, NAMED, FOODS, MUJOCO = "develop", "drawn", "named", "foods", "mujoco"
TABLE_A2 = ("wd", "ood-1", "ood-2", "ood-3", "ood-4")
"""The targets of the paper, for each of its tasks."""


@dataclass(frozen=True, eq=False)
class BenchmarkWorld:
    """A world and its set; results of different sets are never pooled."""

    set: str
    world: World

    @property
    def name(self) -> str:
        """The world's name."""
        return self.world.name


SETS: dict[str, Callable[[Task], tuple[World, ...]]] = {
    DEVELOP: lambda task: _drawn(task, REPORT, DEVELOP_SEED),
    REPORT: lambda task: _drawn(task, REPORT, REPORT_SEED),
    NAMED: shipped_worlds,
    FOODS: lambda task: _drawn(task, FOODS, FOODS_SEED),
    MUJOCO: lambda task: shipped_worlds(task, "mujoco"),
}
"""Every set of worlds by its name; the only list of them."""

RULES: dict[str, Callable[[Task, int, int], World]] = {REPORT: drawn_world, FOODS: food_world}
"""The first part of a world's name -> the function that draws the world of a seed and number."""
_NAMED_SEEDS = {(REPORT, DEVELOP_SEED): DEVELOP, (REPORT, REPORT_SEED): REPORT, (FOODS, FOODS_SEED): FOODS}


def targets_of(task: Task, names: Sequence[str]) -> tuple[BenchmarkWorld, ...]:
    """The worlds of `names` (sets, names of worlds, files), each once, in order. Raises UnknownName, WorldError."""
    targets: dict[str, BenchmarkWorld] = {}
    for name in names:
        for target in _meant(task, name):
            targets.setdefault(target.name, target)
    if not targets:
        raise UnknownName(f"no target was given: give names of worlds, or {', '.join(SETS)}")
    return tuple(targets.values())


def usual_targets(task: Task) -> tuple[str, ...]:
    """The names of the paper's targets, or of all worlds if the task has no such targets."""
    names = list_worlds(task)
    return TABLE_A2 if set(TABLE_A2) <= set(names) else names


def _meant(task: Task, name: str) -> tuple[BenchmarkWorld, ...]:
    if name in SETS:
        return tuple(BenchmarkWorld(name, world) for world in SETS[name](task))
    drawn = re.fullmatch(rf"({'|'.join(RULES)})-(\d+)(?:-(\d+))?", name)
    if drawn and int(drawn[3] or 0) < DRAWN:
        rule, seed, number = drawn[1], int(drawn[2]), drawn[3]
        worlds = _drawn(task, rule, seed) if number is None else (RULES[rule](task, seed, int(number)),)
        return tuple(BenchmarkWorld(_NAMED_SEEDS.get((rule, seed), f"{rule}-{seed}"), world) for world in worlds)
    try:
        world = load_world(name, task)
        return (BenchmarkWorld(MUJOCO if world.physics == "mujoco" else NAMED, world),)
    except UnknownName as error:
        raise UnknownName(f"{error}; sets of worlds are {', '.join(SETS)}") from error


def _drawn(task: Task, rule: str, seed: int) -> tuple[World, ...]:
    return tuple(RULES[rule](task, seed, number) for number in range(DRAWN))
