"""The next stage of a session: a trial, the adaptation, or to show a complete iteration. Pure.

The same rule serves a session on the disk, which may be continued after any step, and one in memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np


class Role(StrEnum):
    """Whose policy acts in a trial."""

    ALONE = "alone"  # the session's own, in an iteration without control trials
    OWN = "own"  # the session's own, in an iteration with them
    CONTROL = "control"


class TrialKey(NamedTuple):
    """A trial's number in its session (from 1) and its attempt (from 0)."""

    number: int
    attempt: int


class Slot(NamedTuple):
    """The place of a trial in its iteration."""

    particle: int
    trial: int  # within its particle and iteration
    role: Role


@dataclass(frozen=True)
class Layout:
    """The trials of an iteration, and their order. Iterations, particles and trials of a particle count from 0.

    With control trials, each trial of a particle has a partner that the control's policy makes in the same context.
    The trials of a particle and their partners are one block, in random order.
    """

    particles: int
    trials: int  # of each particle
    controlled_from: int | None = None  # first iteration with control trials; None: there are none
    seed: int = 0  # of the order within blocks

    def has_control(self, iteration: int) -> bool:
        """Whether an iteration has control trials."""
        return self.controlled_from is not None and iteration >= self.controlled_from

    def slots(self, iteration: int) -> tuple[Slot, ...]:
        """The trials of an iteration, in their order."""
        if not self.has_control(iteration):
            return tuple(Slot(p, t, Role.ALONE) for p in range(self.particles) for t in range(self.trials))
        return tuple(slot for particle in range(self.particles) for slot in self._block(iteration, particle))

    def _block(self, iteration: int, particle: int) -> Iterator[Slot]:
        rng = np.random.default_rng((self.seed, iteration, particle))
        roles = (Role.OWN, Role.CONTROL)
        counts = dict.fromkeys(roles, 0)
        for which in rng.permutation(np.repeat([0, 1], self.trials)):
            role = roles[which]
            yield Slot(particle, counts[role], role)
            counts[role] += 1

    def numbers(self, iteration: int) -> range:
        """The numbers of an iteration's trials within the session."""
        first = 1 + sum(self._size(earlier) for earlier in range(iteration))
        return range(first, first + self._size(iteration))

    def iteration_of(self, number: int) -> int:
        """The iteration that a trial belongs to."""
        iteration = 0
        while number >= self.numbers(iteration).stop:
            iteration += 1
        return iteration

    def _size(self, iteration: int) -> int:
        return self.particles * self.trials * (2 if self.has_control(iteration) else 1)


@dataclass(frozen=True)
class Existing:
    """The content of a session so far."""

    completed: frozenset[TrialKey]
    started: frozenset[TrialKey]  # the motion was about to start: the arm may have moved
    recorded: frozenset[TrialKey]  # the motion is over and stored, the trial is not yet accepted
    rejected: frozenset[TrialKey]  # by the operator, or by a failed placement or recording; without restored ones
    results: Mapping[int, tuple[TrialKey, ...]]  # iteration -> trials of its newest result
    shown: frozenset[int]  # iterations whose newest result has reached the operator
    changes: Mapping[int, int] = field(default_factory=dict)  # iteration -> amended outcomes and restored attempts
    counted: Mapping[int, int] = field(default_factory=dict)  # iteration -> changes included in its newest result


@dataclass(frozen=True)
class RunTrial:
    """The next stage is one trial of the robot."""

    iteration: int
    particle: int
    trial: int  # within its particle and iteration
    key: TrialKey
    interrupted: bool = False  # the motion started and was never stored
    recorded: bool = False  # the motion is over and stored: tracking and review are missing
    role: Role = Role.ALONE


@dataclass(frozen=True)
class Adapt:
    """The next stage adapts the particles to the trials of this iteration."""

    iteration: int
    keys: tuple[TrialKey, ...]


@dataclass(frozen=True)
class Show:
    """The next stage shows a complete iteration, because the program ended before it was shown."""

    iteration: int


Stage = RunTrial | Adapt | Show


def next_stage(existing: Existing, layout: Layout) -> Stage:
    """The next stage of a session. There is always one."""
    iteration = 0
    used = max((key.number for key in existing.started | existing.completed | existing.recorded), default=0)
    while True:
        keys = tuple(current_key(existing, n) for n in layout.numbers(iteration))
        for slot, key in zip(layout.slots(iteration), keys, strict=True):
            if key not in existing.completed:
                recorded = key in existing.recorded
                interrupted = key in existing.started and not recorded
                return RunTrial(iteration, slot.particle, slot.trial, key, interrupted, recorded, slot.role)
        if not _is_settled(existing, iteration, keys, is_used=used > keys[-1].number):
            return Adapt(iteration, keys)
        if iteration not in existing.shown:
            return Show(iteration)
        iteration += 1


def _is_settled(existing: Existing, iteration: int, keys: tuple[TrialKey, ...], *, is_used: bool) -> bool:
    """Whether the newest result of an iteration is final.

    A result that later trials depend on is final despite amendments; the next result reports those.
    """
    if iteration not in existing.results:
        return False
    is_up_to_date = existing.counted.get(iteration, 0) == changes_until(existing, iteration)
    return is_used or (existing.results[iteration] == keys and is_up_to_date)


def changes_until(existing: Existing, iteration: int) -> int:
    """The number of amended outcomes and restored attempts up to and including an iteration."""
    return sum(count for earlier, count in existing.changes.items() if earlier <= iteration)


def current_key(existing: Existing, number: int) -> TrialKey:
    """The attempt of trial `number` that counts: the first one that was not rejected."""
    attempt = 0
    while TrialKey(number, attempt) in existing.rejected:
        attempt += 1
    return TrialKey(number, attempt)
