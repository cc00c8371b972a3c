"""Reject a trial, so that it is repeated."""

from __future__ import annotations

from datetime import UTC, datetime

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.stages import current_key, trial_numbers
from adaptsim_cli.session.store import SessionStore


def redo(store: SessionStore, number: int, reason: str) -> int:
    """Mark trial `number` as not counting; returns the number of its next attempt (from 1).

    The trial has to be completed, or recorded and not yet reviewed, and no later iteration may depend on it.
    Raises UsageError, SessionError.
    """
    facts = store.facts
    with store.locked():
        existing = store.existing()
        iteration = (number - 1) // (facts.particles * facts.trials)
        key = current_key(existing, number)
        if key not in existing.completed | existing.recorded:
            done = sorted({k.number for k in existing.completed})
            raise UsageError(f"trial {number} of {facts.name} is not completed; completed are {done or 'none'}")
        later = trial_numbers(iteration + 1, facts.particles, facts.trials).start
        if any(k.number >= later for k in existing.started | existing.completed):
            raise UsageError(
                f"trial {number} belongs to iteration {iteration + 1}, and later trials use the result of "
                "that iteration; only trials of the newest iteration can be redone. To change its outcome: adaptsim "
                f"sessions amend {facts.name} {number}"
            )
        store.reject(iteration, key, datetime.now(UTC).isoformat(timespec="seconds"), reason)
    return key.attempt + 2
