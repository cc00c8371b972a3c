"""Corrections of a stored session: amended outcomes, restored attempts, redone trials."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.outputs.sessions import Amended
from adaptsim_cli.screen.outputs.trials import as_observed
from adaptsim_cli.screen.views import words
from adaptsim_cli.session import records
from adaptsim_cli.session.history import completed
from adaptsim_cli.session.operator import Choices
from adaptsim_cli.session.records import Amendment, TrialRecord
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.stages import TrialKey, current_key
from sim.tasks.task import Task

_STEP = timedelta(seconds=1)


def restore(store: SessionStore, number: int, attempt: int | None, reason: str) -> tuple[Amended, str]:
    """Let a rejected attempt of trial `number` count again: `attempt` (from 0), or the newest one with a recording.

    Returns the change, and its effect on the rest of the session in one sentence. An attempt that was never accepted is
    tracked and reviewed by the next run-iteration. Raises UsageError, SessionError.
    """
    with store.locked():
        existing, iteration = store.existing(), store.iteration_of(number)
        able = sorted(
            key
            for key in existing.rejected & (existing.completed | existing.recorded)
            if key.number == number and store.motion(iteration, key).stopped is None
        )
        if not able:
            raise UsageError(
                f"trial {number} of {store.facts.name} has no rejected attempt with a complete recording, so there is "
                "nothing to restore"
            )
        key = able[-1] if attempt is None else TrialKey(number, attempt)
        if key not in able:
            attempts = ", ".join(str(k.attempt + 1) for k in able)
            raise UsageError(
                f"--attempt {key.attempt + 1}: attempts of trial {number} that can be restored: {attempts}"
            )
        now = _now(store)
        began = existing.started | existing.recorded | existing.completed
        others = sorted(other for other in began - existing.rejected if other.number == number)
        for other in others:
            store.reject(iteration, other, now, f"attempt {key.attempt + 1} counts instead")
        store.restore(iteration, key, now, reason)
        waits = "" if key in existing.completed else "; the next run-iteration asks for its review, and nothing moves"
        instead = f" instead of attempt {others[-1].attempt + 1}" if others else ""
        what = f"attempt {key.attempt + 1} of trial {number} counts again{instead}{waits}"
        return _told(store, key, what)


def amendable(
    store: SessionStore, task: Task, outcomes: tuple[Outcome, ...], number: int
) -> tuple[TrialRecord, Choices]:
    """The completed trial `number` that counts, and its reward under each possible outcome.

    Raises UsageError, SessionError.
    """
    record = completed(store, number)
    choices = choices_of(task, outcomes, record.track.track(), record.context_array)
    if not choices:
        raise UsageError(f"trial {number} of {store.facts.name} was simulated without a camera: its outcome is exact")
    return record, choices


def choices_of(task: Task, outcomes: tuple[Outcome, ...], track: ObjectTrack, context: Array) -> Choices:
    """Every outcome that the track can support in this context (c,), with its reward."""
    rewards = {outcome: task.score(replace(track, outcome=outcome), context) for outcome in outcomes}
    return {outcome: reward for outcome, reward in rewards.items() if np.isfinite(reward)}


def overruled(task: Task, record: TrialRecord, outcome: Outcome) -> TrialRecord:
    """The trial with the outcome that the operator saw, scored again."""
    track = replace(record.track.track(), outcome=outcome)
    return record.counting_as(outcome, task.score(track, record.context_array), as_observed(task.observation(track)))


def amend(
    store: SessionStore, task: Task, number: int, outcome: Outcome, reward: float, reason: str
) -> tuple[Amended, str]:
    """Let the completed trial `number` count with `outcome` and `reward`. Returns what `restore` returns.

    Raises UsageError, SessionError.
    """
    with store.locked():
        record = completed(store, number)
        if record.outcome == outcome:
            raise UsageError(f"trial {number} of {store.facts.name} counts as {words(outcome.value)} already")
        track = replace(record.track.track(), outcome=outcome)
        amendment = Amendment(
            at=_now(store),
            text=reason,
            outcome=outcome,
            outcome_before=record.outcome,
            reward=reward,
            reward_before=record.reward,
            observation=as_observed(task.observation(track)),
        )
        store.amend(*record.position, amendment)
        return _told(store, record.position[1], amended_words(number, amendment))


def amended_words(number: int, by: Amendment) -> str:
    """One amendment in words."""
    return (
        f"trial {number} counts as {words(by.outcome.value)} instead of {words(by.outcome_before.value)}, reward "
        f"{by.reward:.2f} instead of {by.reward_before:.2f}: {by.text}"
    )


def sentences(store: SessionStore, until: int, count: int) -> tuple[str, ...]:
    """The amendments and restorations in the iterations up to `until`, without the first `count`, in words."""
    changes = sorted(
        (change for iteration in range(until + 1) for change in store.changes(iteration)), key=lambda c: c.note.at
    )
    return tuple(
        amended_words(change.key.number, change.note)
        if isinstance(change.note, Amendment)
        else f"attempt {change.key.attempt + 1} of trial {change.key.number} counts again: {change.note.text}"
        for change in changes[count:]
    )


def _told(store: SessionStore, key: TrialKey, what: str) -> tuple[Amended, str]:
    """The change `what` of a trial, and its effect on the rest of the session."""
    existing, iteration = store.existing(), store.iteration_of(key.number)
    begun = existing.started | existing.completed | existing.recorded
    later = max([0, *(store.iteration_of(other.number) - iteration for other in begun)])
    changed = Amended(session=store.facts.name, trial=key.number, attempt=key.attempt + 1, changed=what)
    if not later:
        return changed, "The next run-iteration adapts again from the trials that now count."
    last = iteration + 1 + later
    which = f"Iteration {last} was" if later == 1 else f"Iterations {iteration + 2} to {last} were"
    return (
        changed,
        f"{which} made with policies from before. They stay; the next adaptation takes the change into account.",
    )


def _now(store: SessionStore) -> str:
    """The time of a change: later than every earlier change, even if the clock went backwards."""
    times = [change.note.at for iteration in range(store.iterations()) for change in store.changes(iteration)]
    now = datetime.now(UTC).replace(microsecond=0)
    earliest = max((datetime.fromisoformat(at) for at in times), default=now - _STEP) + _STEP
    return max(now, earliest).isoformat(timespec="seconds")


def redo(store: SessionStore, number: int, reason: str) -> int:
    """Mark trial `number` as not counting; returns the number of its next attempt (from 1).

    The trial has to be completed, or recorded and not yet reviewed, and no later iteration may depend on it.
    Raises UsageError, SessionError.
    """
    facts = store.facts
    with store.locked():
        existing = store.existing()
        iteration, key = store.iteration_of(number), current_key(existing, number)
        if key not in existing.recorded:
            completed(store, number)  # raises
        later = facts.layout.numbers(iteration + 1).start
        if any(k.number >= later for k in existing.started | existing.completed):
            raise UsageError(
                f"trial {number} belongs to iteration {iteration + 1}, and later trials use the result of "
                "that iteration; only trials of the newest iteration can be redone. To change its outcome: adaptsim "
                f"sessions amend {facts.name} {number}"
            )
        store.reject(iteration, key, records.now(), reason)
        return current_key(store.existing(), number).attempt + 1
