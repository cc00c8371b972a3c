"""What comes next in a session: a trial, the adaptation, or to show a complete iteration. Pure.

The same rule serves a session on the disk, which may be continued after any step, and one in memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple


class TrialKey(NamedTuple):
    """A trial's number in its session (from 1) and its attempt (from 0)."""

    number: int
    attempt: int


@dataclass(frozen=True)
class Existing:
    """What a session holds so far."""

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
    """Next: one trial of the robot."""

    iteration: int
    particle: int
    trial: int  # within its particle and iteration
    key: TrialKey
    interrupted: bool = False  # the motion started and was never stored
    recorded: bool = False  # the motion is over and stored: tracking and review are missing


@dataclass(frozen=True)
class Adapt:
    """Next: adapt the particles to the trials of this iteration."""

    iteration: int
    keys: tuple[TrialKey, ...]


@dataclass(frozen=True)
class Show:
    """Next: show a complete iteration, because the program ended before it did."""

    iteration: int


Stage = RunTrial | Adapt | Show


def next_stage(existing: Existing, particles: int, trials: int) -> Stage:
    """The next stage of a session with `particles` x `trials` trials per iteration. There is always one."""
    iteration = 0
    used = max((key.number for key in existing.started | existing.completed | existing.recorded), default=0)
    while True:
        keys = tuple(current_key(existing, n) for n in trial_numbers(iteration, particles, trials))
        for index, key in enumerate(keys):
            if key not in existing.completed:
                particle, trial = divmod(index, trials)
                recorded = key in existing.recorded
                interrupted = key in existing.started and not recorded
                return RunTrial(iteration, particle, trial, key, interrupted, recorded)
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


def trial_numbers(iteration: int, particles: int, trials: int) -> range:
    """The numbers of the trials of one iteration within the session, particle by particle."""
    first = 1 + iteration * particles * trials
    return range(first, first + particles * trials)


def current_key(existing: Existing, number: int) -> TrialKey:
    """The attempt of trial `number` that counts: the first one that was not rejected."""
    attempt = 0
    while TrialKey(number, attempt) in existing.rejected:
        attempt += 1
    return TrialKey(number, attempt)
