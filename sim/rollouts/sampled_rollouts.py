"""The rollouts by which a task is examined, and the text of a finding."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import RolloutError, simulating
from sim.rollouts.draws import sobol
from sim.tasks.task import Task

Mark = Literal["kept", "doubtful", "broken"]


SPREAD, MOST, LEAST = 24, 512, 8
"""Number of rollouts all over the ranges, besides those at their ends: the largest for quick rollouts, the smallest for
slow ones."""

MOST_NUMBERS = 10_000_000
"""Numbers in the states of all these rollouts, which stay in memory."""


@dataclass(frozen=True)
class TaskFinding:
    """One rule that a task keeps or breaks."""

    check: str
    mark: Mark
    detail: str = ""  # a sentence; empty if there is nothing to say


@dataclass(frozen=True, eq=False)
class SampledRollout:
    """One rollout with its inputs."""

    parameters: Array
    context: Array
    action: Array
    nuisance: Array
    track: ObjectTrack
    seconds: float

    @property
    def inputs(self) -> tuple[Array, Array, Array, Array]:
        """Parameters, context, action and nuisance."""
        return self.parameters, self.context, self.action, self.nuisance


@dataclass(frozen=True)
class Cost:
    """The time of a rollout."""

    rollouts: int
    median_s: float
    longest_s: float


def sampled_rollouts(task: Task, rng: np.random.Generator, limit_s: float) -> tuple[list[SampledRollout], int]:
    """Simulate rollouts: the first at the middle, then each quantity at its ends, then everywhere.

    Returns them, and the number of those up to the last end.
    """
    spaces = (task.margin, task.context, task.action, task.nuisance)
    middle = [np.asarray(space.middle) for space in spaces]
    middle[1] = np.asarray(task.reference_context, dtype=np.float64)
    points = [tuple(middle)]
    for which in (0, 2):
        for i, d in enumerate(spaces[which].dimensions):
            for end in (d.low, d.high):
                moved = [values.copy() for values in middle]
                moved[which][i] = end
                points.append(tuple(moved))
    at_ends = len(points)
    unit = sobol(MOST, sum(map(len, spaces)), rng)
    parts = np.split(unit, np.cumsum([len(space) for space in spaces])[:-1], axis=1)
    spread = zip(*(space.spread(part) for space, part in zip(spaces, parts, strict=True)), strict=True)
    points += [tuple(np.asarray(v, dtype=np.float64) for v in row) for row in spread]
    order = [0, *_interleaved(range(1, at_ends), range(at_ends, len(points)))]
    rolls, spent, numbers = dict[int, SampledRollout](), 0.0, 0
    for number in order:
        enough = len(rolls) >= at_ends + SPREAD and spent > limit_s / 4
        if enough or ((spent > limit_s or numbers > MOST_NUMBERS) and len(rolls) >= LEAST):
            break
        rolls[number] = rolled(task, *points[number])
        spent += rolls[number].seconds
        numbers += rolls[number].track.state.size
    return [rolls[number] for number in sorted(rolls)], sum(number < at_ends for number in rolls)


def _interleaved(first: Sequence[int], second: Sequence[int]) -> list[int]:
    """The rollouts in an order in which two thirds are at the ends, so that a slow task is tried there first."""
    left, right, both = [*first], [*second], []
    while left or right:
        both += left[:2] + right[:1]
        left, right = left[2:], right[1:]
    return both


def rolled(task: Task, parameters: Array, context: Array, action: Array, nuisance: Array) -> SampledRollout:
    """One rollout, timed. Raises RolloutError if the task cannot simulate it."""
    began = time.perf_counter()
    p, c, a, n = frozen = tuple(np.array(v) for v in (parameters, context, action, nuisance))
    for values in frozen:
        values.flags.writeable = False
    with simulating(task.name, f"parameters {p.tolist()}, action {a.tolist()}"):
        track = task.simulate(p, c, a, n)
    if not isinstance(track, ObjectTrack):
        raise RolloutError(f"`simulate` of the task {task.name} returns {type(track).__name__}, not an ObjectTrack")
    return SampledRollout(p, c, a, n, track, time.perf_counter() - began)


def described(task: Task, one: SampledRollout) -> str:
    """The inputs of a rollout by name."""
    spaces = (task.parameters, one.parameters), (task.context, one.context), (task.action, one.action)
    return ", ".join(space.in_words(values) for space, values in spaces if len(space))
