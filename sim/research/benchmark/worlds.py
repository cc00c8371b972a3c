"""The worlds of a benchmark by name.

`develop` and `drawn` are forty worlds each, drawn by `sim.lab.drawn`, none discarded. Methods are developed on
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
from sim.lab.world import World, load_world, shipped_worlds
from sim.tasks.task import Task

DRAWN = 40
DEVELOP_SEED, REPORT_SEED, FOODS_SEED = 0, 2, 5
DEVELOP, REPORT, NAMED, FOODS, MUJOCO = "develop", "drawn", "named", "foods", "mujoco"


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
    DEVELOP: lambda task: _drawn(task, DEVELOP_SEED),
    REPORT: lambda task: _drawn(task, REPORT_SEED),
    NAMED: shipped_worlds,
    FOODS: lambda task: _foods(task, FOODS_SEED),
    MUJOCO: lambda task: shipped_worlds(task, "mujoco"),
}
"""Every set of worlds by its name; the only list of them."""


def targets_of(task: Task, names: Sequence[str]) -> tuple[BenchmarkWorld, ...]:
    """The worlds of `names` (sets, names of worlds, files), each once, in order. Raises UnknownName, WorldError."""
    targets: dict[str, BenchmarkWorld] = {}
    for name in names:
        for target in _meant(task, name):
            targets.setdefault(target.name, target)
    if not targets:
        raise UnknownName(f"no target was given: give names of worlds, or {', '.join(SETS)}")
    return tuple(targets.values())


def _meant(task: Task, name: str) -> tuple[BenchmarkWorld, ...]:
    if name in SETS:
        return tuple(BenchmarkWorld(name, world) for world in SETS[name](task))
    drawn = re.fullmatch(r"(drawn|foods)-(\d+)(?:-(\d+))?", name)
    if drawn and int(drawn[3] or 0) < DRAWN:
        rule, seed = drawn[1], int(drawn[2])
        worlds = _foods(task, seed) if rule == FOODS else _drawn(task, seed)
        names = {(REPORT, DEVELOP_SEED): DEVELOP, (REPORT, REPORT_SEED): REPORT, (FOODS, FOODS_SEED): FOODS}
        chosen = worlds if drawn[3] is None else worlds[int(drawn[3]) :][:1]
        return tuple(BenchmarkWorld(names.get((rule, seed), f"{rule}-{seed}"), world) for world in chosen)
    try:
        world = load_world(name, task)
        return (BenchmarkWorld(MUJOCO if world.physics == "mujoco" else NAMED, world),)
    except UnknownName as error:
        raise UnknownName(f"{error}; sets of worlds are {', '.join(SETS)}") from error


def _drawn(task: Task, seed: int) -> tuple[World, ...]:
    return tuple(drawn_world(task, seed, number) for number in range(DRAWN))


def _foods(task: Task, seed: int) -> tuple[World, ...]:
    if task.name != "scooping":
        raise UnknownName(f"foods are worlds of scooping, not of {task.name}")
    return tuple(food_world(task, seed, number) for number in range(DRAWN))
