"""The checkpoint as a session uses it: its own solver, the recorded trials that replace a lab, the posterior of another
session to begin with.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli import config
from adaptsim_cli.bench.checkpoints import checkpoint_of, own_checkpoints, task_of
from adaptsim_cli.config import DIRECT, SOLVERS, Config
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.folders import solver_folder
from hw.computer import usable_cores
from sim.rollouts.executors import serial_executor

if TYPE_CHECKING:
    from adaptsim_cli.session.records import SessionFacts
    from adaptsim_cli.session.store import SessionStore
    from perception.types import ObjectTrack
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.method import Simulating
    from sim.rollouts.recorded import RecordedTrials
    from sim.tasks.task import Expectations, Policies, Task


def checkpoint_of_session(store: SessionStore) -> Checkpoint:
    """The checkpoint that a stored session was begun with, found by the hash of its weights.

    With recorded trials its policies choose among those shown; with `start_from`, its prior is that posterior. Raises
    CheckpointError if it is neither a shipped one, nor that of the settings, nor one of the user's own.
    """
    from adaptsim_cli.session.session_policies import with_session_policies
    from sim.adaptation.card import read_card
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.errors import CheckpointError

    facts = store.facts
    task = task_of(config.load().config.model_copy(update={"task": facts.task, "object": facts.object}))
    if facts.solver == DIRECT:
        return direct_checkpoint(task, serial_executor(), solver_folder(store.folder))
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


def direct_checkpoint(task: Task, executor: Executor, folder: Path) -> Checkpoint:
    """The replacement of the checkpoint in a session with the direct solver, which keeps its rollouts in `folder`.

    Raises UsageError for a task that trains its policies.
    """
    from sim.adaptation.checkpoint import without_phase_1
    from sim.adaptation.method import Simulating
    from sim.adaptation.methods import make_method

    if task.training is not None:
        raise UsageError(
            f"--solver direct: {task.name} trains its policies, which is a part of Phase 1. Leave --solver out, and "
            f"run adaptsim pretrain --task {task.name}"
        )
    seconds = list[float]()

    def timed(*values: Any, **named: Any) -> ObjectTrack:
        began = time.monotonic()
        track = task.simulate(*values, **named)
        seconds.append(time.monotonic() - began)
        return track

    method = make_method(DIRECT, task, None)
    assert isinstance(method, Simulating)
    checkpoint = without_phase_1(replace(task, simulate=timed), method.solver)
    method.rollouts.executor, method.rollouts.seconds = executor, min(seconds)  # the first one may load a simulator
    method.rollouts.keep_in(folder / "rollouts")
    return checkpoint


@contextmanager
def checkpoint_in_session(settings: Config, folder: Path) -> Iterator[Checkpoint]:
    """The checkpoint of the settings, or its replacement for the direct solver, with the processes that simulate.

    `folder` keeps its rollouts. Raises as `checkpoint_of`.
    """
    if settings.solver != DIRECT:
        yield checkpoint_of(settings)
        return
    from sim.rollouts.executors import simulating_executor

    with simulating_executor(settings.workers) as executor:
        yield direct_checkpoint(task_of(settings), executor, folder)


def cost_in_words(method: Simulating, settings: Config) -> str:
    """The cost of a session that simulates while it runs, before it begins."""
    cores, particles, seconds = settings.workers or usable_cores(), settings.particles, method.rollouts.seconds
    before, after = method.rollouts_before(particles), [method.rollouts_after(particles, i) for i in (1, 2)]
    total = before + sum(after)
    each = f"{1e3 * seconds:.2g} ms" if seconds < 0.1 else f"{seconds:.2g} s"
    return (
        f"No Phase 1: this session simulates up to {before} rollouts before its first trial, {after[0]} after the "
        f"first iteration, and {after[1]} after the second. A rollout takes {each}, so these {total} take about "
        f"{seconds * total / cores:.0f} s on {cores} cores."
    )


def _folders(facts: SessionFacts) -> Iterator[Path]:
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
    if name != "naf" and not checkpoint.naf:  # the direct solver is its checkpoint's own
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


def recordings_of(
    checkpoint: Checkpoint,
    settings: Config | SessionFacts,
    check: Callable[[RecordedTrials, Expectations], RecordedTrials] = lambda trials, _: trials,
) -> Recordings:
    """The recordings that the settings name. `check` may refuse them, or add notes, when a session begins.

    Raises RecordingsRefused, SessionError, ExtraMissing.
    """
    from adaptsim_cli.session.recorded.folder import digest, read_recorded

    trials = check(read_recorded(checkpoint.solver.task, Path(settings.recorded)), checkpoint.solver)
    shown, held_out = trials.split(settings.held_out, settings.seed)
    return Recordings(shown, held_out, _choosing_among(checkpoint, shown), digest(trials))


def as_begun(checkpoint: Checkpoint, facts: SessionFacts) -> Checkpoint:
    """The checkpoint as a stored session uses it. Raises UsageError, SimError, SessionError."""
    started, _ = started_from(checkpoint, facts)
    return recordings_of(started, facts).checkpoint if facts.recorded else started


def started_from(checkpoint: Checkpoint, settings: Config | SessionFacts) -> tuple[Checkpoint, str]:
    """The checkpoint with the posterior of the session `start_from` as its prior, and the SHA-256 of that posterior.

    Without such a session, the checkpoint is unchanged and the hash is empty. Raises UsageError, SessionError,
    CheckpointError.
    """
    import hashlib

    from adaptsim_cli.session.history import history_of
    from adaptsim_cli.session.store import SessionStore
    from sim.adaptation.methods import METHODS, kind_of
    from sim.adaptation.posterior import likelihood_of, posterior
    from sim.adaptation.reward_table import begun_with

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
    earlier = posterior(likelihood_of(before), history_of(task, store, store.iterations() - 1))
    assert checkpoint.reward_table is not None  # else there is no likelihood
    reward_table = begun_with(checkpoint.reward_table, task, earlier.samples, earlier.weights)
    return replace(checkpoint, reward_table=reward_table), hashlib.sha256(reward_table.truths.tobytes()).hexdigest()


def _choosing_among(checkpoint: Checkpoint, trials: RecordedTrials) -> Checkpoint:
    from sim.solvers.candidates import with_listed_actions

    return replace(checkpoint, solver=with_listed_actions(checkpoint.solver, trials.actions))
