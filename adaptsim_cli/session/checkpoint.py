"""The checkpoint as a session uses it: its own solver, the recorded trials that replace a lab, the posterior of another
session to begin with.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli import config
from adaptsim_cli.bench.checkpoints import own_checkpoints, task_of
from adaptsim_cli.config import Config
from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from adaptsim_cli.session.records import Facts
    from adaptsim_cli.session.store import SessionStore
    from sim.adaptation.checkpoint import Checkpoint
    from sim.rollouts.recorded import RecordedTrials
    from sim.solvers.solver import Expectations, Policies

SOLVERS = ("emulator", "naf")


def checkpoint_of_session(store: SessionStore) -> Checkpoint:
    """The checkpoint that a stored session was begun with, found by the hash of its weights.

    With recorded trials its policies choose among those shown; with `start_from`, its prior is that posterior. Raises
    CheckpointError if it is neither a shipped one, nor that of the settings, nor one of the user's own.
    """
    from adaptsim_cli.session.session_policies import with_session_policies
    from sim.adaptation.checkpoint import load_checkpoint, read_card
    from sim.errors import CheckpointError

    facts = store.facts
    task = task_of(config.load().config.model_copy(update={"task": facts.task, "object": facts.object}))
    for folder in _folders(facts):
        try:
            if read_card(folder, task.name).sha256 == facts.checkpoint_sha256:
                checkpoint = with_session_policies(load_checkpoint(task, str(folder)), store.folder, 1, None)
                return as_begun(checkpoint, facts)
        except CheckpointError:
            continue
    raise CheckpointError(
        f"session {facts.name!r} was begun with the checkpoint {facts.checkpoint} ({facts.checkpoint_sha256[:12]}), "
        "which is no longer here: name its folder with ADAPTSIM_CHECKPOINT"
    )


def _folders(facts: Facts) -> Iterator[Path]:
    """Folders that may hold a session's checkpoint: that of the settings, its own, shipped ones, the user's own."""
    from sim.tasks import files_of

    yield from (Path(named) for named in (config.load().config.checkpoint, facts.checkpoint_folder) if named)
    yield from sorted(files_of(facts.task, "checkpoints").glob("*"))
    yield from own_checkpoints()


@contextmanager
def solver_of(checkpoint: Checkpoint, name: str, workers: int, folder: Path) -> Iterator[tuple[Policies, Expectations]]:
    """The solver `name` (empty: the checkpoint's own), on `workers` processes (0: one per core).

    Only NAF simulates: it stores rollouts and policies in `folder`, which belongs to this session. Its settings are the
    checkpoint's, if that was made with NAF, else the paper's. Expectations come from the checkpoint.

    Raises UsageError for an unknown name and for a solver that the checkpoint does not contain, UnknownName for a task
    without NAF, CheckpointError if `folder` holds other data.
    """
    if name not in ("", *SOLVERS):
        raise UsageError(f"--solver {name}: choose one of {', '.join(SOLVERS)}")
    if name == "emulator" and checkpoint.naf:
        raise UsageError(
            f"--solver emulator: the checkpoint {checkpoint.path} was made with --solver naf and holds no emulator. "
            "Leave --solver out, or choose another checkpoint"
        )
    own = checkpoint.solver
    if name != "naf" and not checkpoint.naf:
        yield own, own
        return
    from sim.solvers.solver import naf

    with naf().in_session(own.task, checkpoint.naf, workers, folder) as solver:
        yield solver, solver if checkpoint.naf else own


@dataclass(frozen=True, eq=False)
class Recordings:
    """The recorded trials of a session, and its checkpoint. Policies choose among the trials that are shown."""

    shown: RecordedTrials
    held_out: RecordedTrials
    checkpoint: Checkpoint
    sha256: str  # of all trials

    @property
    def of_held_out(self) -> Checkpoint:
        """The checkpoint whose policies choose among the trials held out."""
        return _choosing_among(self.checkpoint, self.held_out)


def recordings_of(checkpoint: Checkpoint, settings: Config | Facts, *, begins: bool = False) -> Recordings:
    """The recordings that the settings name; those of a session that `begins` are compared with the simulator.

    Raises RecordingsRefused, SessionError, ExtraMissing.
    """
    from adaptsim_cli.session.recorded.folder import compared, digest, read_recorded

    trials = read_recorded(checkpoint.solver.task, Path(settings.recorded))
    if begins:
        trials = compared(trials, checkpoint.solver)
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

    from adaptsim_cli.session.history import history_of
    from adaptsim_cli.session.store import SessionStore
    from sim.adaptation.methods import METHODS, kind_of
    from sim.adaptation.methods.belief import create
    from sim.adaptation.posterior import posterior
    from sim.adaptation.reward_table import weighed

    if not settings.start_from:
        return checkpoint, ""
    if not kind_of(settings.method).takes_posterior:
        able = " and ".join(name for name, kind in METHODS.items() if kind.takes_posterior)
        raise UsageError(f"--start-from: {settings.method} knows no posterior; only {able} can begin with one")
    store = SessionStore.open(config.places().sessions, settings.start_from)
    if store.facts.checkpoint_sha256 != checkpoint.sha256:
        raise UsageError(
            f"--start-from {settings.start_from}: that session has the checkpoint {store.facts.checkpoint} "
            f"({store.facts.checkpoint_sha256[:12]}), and this one {checkpoint.path.name} ({checkpoint.sha256[:12]}): "
            "their parameters cannot be compared"
        )
    before, _ = started_from(checkpoint, store.facts)  # it may have begun so itself
    task = before.solver.task
    weights = posterior(create(task, before), history_of(task, store, store.iterations() - 1)).weights
    assert before.prospects is not None  # else there is no belief
    prospects = weighed(before.prospects, weights)
    return replace(checkpoint, prospects=prospects), hashlib.sha256(prospects.truths.tobytes()).hexdigest()


def _choosing_among(checkpoint: Checkpoint, trials: RecordedTrials) -> Checkpoint:
    from sim.solvers.candidates import with_listed_actions

    return replace(checkpoint, solver=with_listed_actions(checkpoint.solver, trials.actions))
