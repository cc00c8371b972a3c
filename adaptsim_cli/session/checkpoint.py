"""The settings of a command and the parts that they name: task, checkpoint, solver, and for a session the recorded
trials that replace a lab or the posterior of another session.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli import config
from adaptsim_cli.config import Config, Resolved
from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from adaptsim_cli.session.records import Facts
    from adaptsim_cli.session.store import SessionStore
    from sim.adaptation.checkpoint import Checkpoint
    from sim.rollouts.recorded import RecordedTrials
    from sim.solvers.solver import Expectations, Policies
    from sim.tasks.task import Task

SOLVERS = ("emulator", "naf")

_WORLD = "world "
"""First word of the origin of a task that the world decides."""


def load(flags: Mapping[str, Any]) -> Resolved:
    """Load the settings; the world decides the task if its name comes from closer to the command line.

    Raises UsageError, also if several tasks have a world of that name and the settings name none of these tasks,
    UnknownName or WorldError for a world that no task has.
    """
    resolved = config.load(flags)
    settings, sources = resolved.config, resolved.sources
    if not settings.is_simulated or _rank(resolved, sources["world"]) <= _rank(resolved, sources["task"]):
        return resolved
    from sim.lab.world import load_world, tasks_of_world
    from sim.tasks import get_task

    tasks = tasks_of_world(settings.world)
    if not tasks:
        load_world(settings.world, get_task(settings.task))
    if len(tasks) != 1:
        if settings.task in tasks:
            return resolved
        raise UsageError(f"--world {settings.world}: there is one for {' and one for '.join(tasks)}; add --task")
    chosen = settings.model_copy(update={"task": tasks[0]})
    return replace(resolved, config=chosen, sources={**sources, "task": _WORLD + settings.world})


def named_by_flags(resolved: Resolved) -> frozenset[str]:
    """The settings that flags name, with the task that their world decides."""
    decided = resolved.sources["task"].startswith(_WORLD)
    return resolved.flags | {"task"} if decided else resolved.flags


def _rank(resolved: Resolved, source: str) -> int:
    """How close to the command line a setting comes from."""
    files = ("default", str(resolved.places.user_file), str(resolved.places.project_file))
    if source in files:
        return files.index(source)
    return len(files) + (source == config.FLAG)


def task_of(settings: Config) -> Task:
    """The task of the settings, with the ranges of an own object. Raises UnknownName, ObjectError."""
    from sim.tasks import get_task
    from sim.tasks.own_object import load_object, with_ranges

    task = get_task(settings.task)
    return with_ranges(task, load_object(Path(settings.object))) if settings.object else task


def checkpoint_of(settings: Config) -> Checkpoint:
    """The checkpoint that the settings name; else the newest one for the ranges of an own object; else the shipped one.

    Nothing of other ranges serves an own object. Raises UnknownName, ObjectError, CheckpointError.
    """
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.errors import CheckpointError

    task = task_of(settings)
    if not settings.object or settings.checkpoint:
        return load_checkpoint(task, settings.checkpoint or "default")
    if not (fitting := _pretrained(task)):
        raise CheckpointError(
            f"nothing is pretrained for the ranges of {settings.object} yet: adaptsim pretrain --task {task.name} "
            f"--object {settings.object}"
        )
    return load_checkpoint(task, str(fitting[-1]))


def own_checkpoints() -> list[Path]:
    """Folders of the checkpoints that `adaptsim pretrain` made in its default place, newest last."""
    from sim.adaptation.checkpoint import CARD

    cards = config.places().pretraining.glob(f"*/checkpoint/{CARD}")
    return [card.parent for card in sorted(cards, key=lambda card: card.stat().st_mtime_ns)]


def _pretrained(task: Task) -> list[Path]:
    """The checkpoints for exactly these ranges, the newest own one last."""
    from sim.adaptation.checkpoint import read_card
    from sim.errors import CheckpointError
    from sim.tasks import files_of
    from sim.tasks.fingerprint import fingerprint

    def fits(folder: Path) -> bool:
        try:
            return read_card(folder, task.name).fingerprint == fingerprint(task)
        except CheckpointError:
            return False

    shipped = sorted(files_of(task.name, "checkpoints").glob("*"))
    return [folder for folder in (*shipped, *own_checkpoints()) if fits(folder)]


def list_checkpoints() -> list[dict[str, str]]:
    """Shipped checkpoints and the user's own ones; an unreadable card is noted under `created`."""
    from sim.adaptation.checkpoint import list_checkpoints, read_card
    from sim.errors import CheckpointError

    def row(name: str, folder: Path) -> dict[str, str]:
        try:
            card = read_card(folder, "any task")
            task, created = card.task, str(card.created or "")
        except CheckpointError as error:
            task, created = "?", f"cannot be read: {error}"
        return {"task": task, "name": name, "created": created, "folder": str(folder)}

    named = [(name, folder) for _, name, folder in list_checkpoints()]
    named += [(folder.parent.name, folder) for folder in own_checkpoints()]
    return [row(name, folder) for name, folder in named]


def checkpoint_of_session(store: SessionStore) -> Checkpoint:
    """The checkpoint that a stored session was begun with, found by the hash of its weights.

    With recorded trials its policies choose among those shown; with `start_from`, its prior is that posterior. Raises
    CheckpointError if it is neither a shipped one, nor that of the settings, nor one of the user's own.
    """
    from sim.adaptation.checkpoint import load_checkpoint, read_card
    from sim.errors import CheckpointError

    facts = store.facts
    task = task_of(config.load().config.model_copy(update={"task": facts.task, "object": facts.object}))
    for folder in _folders(facts):
        try:
            if read_card(folder, task.name).sha256 == facts.checkpoint_sha256:
                return as_begun(load_checkpoint(task, str(folder)), facts)
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


def recordings_of(checkpoint: Checkpoint, settings: Config | Facts) -> Recordings:
    """The recordings that the settings name. Raises RecordingsRefused, SessionError, ExtraMissing."""
    from adaptsim_cli.session.recorded.folder import digest, read_recorded

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
