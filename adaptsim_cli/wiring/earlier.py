"""What a session takes from before it began: recorded trials instead of a lab, and the posterior of another session."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.config import Config, places
from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from adaptsim_cli.session.records import Facts
    from sim.adaptation.checkpoint import Checkpoint
    from sim.rollouts.recorded import RecordedTrials

STARTING = ("adaptsim", "adaptsim-belief")
"""The methods that weigh possible truths, and so can begin with the posterior of another session."""


@dataclass(frozen=True, eq=False)
class Recordings:
    """The recorded trials of a session, and a checkpoint whose policies choose among the shown ones."""

    shown: RecordedTrials
    held_out: RecordedTrials
    checkpoint: Checkpoint
    sha256: str  # of all trials

    @property
    def of_held_out(self) -> Checkpoint:
        """The checkpoint whose policies choose among the trials held out."""
        return _choosing_among(self.checkpoint, self.held_out)


def recordings_of(checkpoint: Checkpoint, settings: Config | Facts) -> Recordings:
    """The recordings that the settings name. Raises RecordingsRefused, SessionError, ExtraMissing."""
    from adaptsim_cli.wiring.recorded.folder import digest, read_recorded

    trials = read_recorded(checkpoint.solver.task, Path(settings.recorded))
    shown, held_out = trials.split(settings.held_out, settings.seed)
    return Recordings(shown, held_out, _choosing_among(checkpoint, shown), digest(trials))


def as_begun(checkpoint: Checkpoint, facts: Facts) -> Checkpoint:
    """The checkpoint as a stored session uses it. Raises UsageError, SimError, SessionError."""
    started, _ = started_from(checkpoint, facts)
    return recordings_of(started, facts).checkpoint if facts.recorded else started


def started_from(checkpoint: Checkpoint, settings: Config | Facts) -> tuple[Checkpoint, str]:
    """The checkpoint with the posterior of the session `start_from` as its prior, and the SHA-256 of that.

    Unchanged, and empty, if there is none. Raises UsageError, SessionError, CheckpointError.
    """
    import hashlib

    from adaptsim_cli.session.store import SessionStore, history_of
    from sim.adaptation.methods.belief import create
    from sim.adaptation.reward_table import weighed

    if not settings.start_from:
        return checkpoint, ""
    if settings.method not in STARTING:
        raise UsageError(
            f"--start-from: {settings.method} knows no posterior; only {' and '.join(STARTING)} can begin with one"
        )
    store = SessionStore.open(places().sessions, settings.start_from)
    if store.facts.checkpoint_sha256 != checkpoint.sha256:
        raise UsageError(
            f"--start-from {settings.start_from}: that session has the checkpoint {store.facts.checkpoint} "
            f"({store.facts.checkpoint_sha256[:12]}), and this one {checkpoint.path.name} ({checkpoint.sha256[:12]}): "
            "their parameters cannot be compared"
        )
    before, _ = started_from(checkpoint, store.facts)  # it may have begun so itself
    task = before.solver.task
    weights = create(task, before).weights(history_of(task, store, store.iterations() - 1))
    assert before.prospects is not None  # else there is no belief
    prospects = weighed(before.prospects, weights)
    return replace(checkpoint, prospects=prospects), hashlib.sha256(prospects.truths.tobytes()).hexdigest()


def _choosing_among(checkpoint: Checkpoint, trials: RecordedTrials) -> Checkpoint:
    from sim.solvers.among import among

    return replace(checkpoint, solver=among(checkpoint.solver, trials.actions))
