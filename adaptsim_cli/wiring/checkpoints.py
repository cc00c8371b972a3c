"""Finds the checkpoint of the settings or of a stored session, lists checkpoints, and chooses the solver for one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.config import Config, load, places
from adaptsim_cli.errors import UsageError
from sim.tasks.task import Task

if TYPE_CHECKING:
    from adaptsim_cli.session.store import SessionStore
    from sim.adaptation.checkpoint import Checkpoint
    from sim.solvers.solver import Expectations, Policies


def task_of(config: Config) -> Task:
    """The task of the settings, with the ranges of an own object. Raises UnknownName, ObjectError."""
    from sim.tasks import get_task
    from sim.tasks.own_object import load_object, with_ranges

    task = get_task(config.task)
    return with_ranges(task, load_object(Path(config.object))) if config.object else task


def checkpoint_of(config: Config) -> Checkpoint:
    """The checkpoint that the settings name; else the newest one for the ranges of an own object; else the shipped one.

    Nothing of other ranges serves an own object. Raises UnknownName, ObjectError, CheckpointError.
    """
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.errors import CheckpointError

    task = task_of(config)
    if not config.object or config.checkpoint:
        return load_checkpoint(task, config.checkpoint or "default")
    if not (fitting := _pretrained(task)):
        raise CheckpointError(
            f"nothing is pretrained for the ranges of {config.object} yet: adaptsim pretrain --task {task.name} "
            f"--object {config.object}"
        )
    return load_checkpoint(task, str(fitting[-1]))


def own_checkpoints() -> list[Path]:
    """Folders of the checkpoints that `adaptsim pretrain` made in its default place, newest last."""
    from sim.adaptation.checkpoint import CARD

    cards = places().pretraining.glob(f"*/checkpoint/{CARD}")
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
    from adaptsim_cli.wiring.earlier import as_begun
    from sim.adaptation.checkpoint import load_checkpoint, read_card
    from sim.errors import CheckpointError

    facts = store.facts
    task = task_of(load().config.model_copy(update={"task": facts.task, "object": facts.object}))
    for folder in _folders(facts.task):
        try:
            if read_card(folder, task.name).sha256 == facts.checkpoint_sha256:
                return as_begun(load_checkpoint(task, str(folder)), facts)
        except CheckpointError:
            continue
    raise CheckpointError(
        f"session {facts.name!r} was begun with the checkpoint {facts.checkpoint} ({facts.checkpoint_sha256[:12]}), "
        "which is no longer here: name its folder with ADAPTSIM_CHECKPOINT"
    )


def _folders(task: str) -> Iterator[Path]:
    """Folders that may hold a session's checkpoint: that of the settings, shipped ones, the user's own."""
    from sim.tasks import files_of

    if named := load().config.checkpoint:
        yield Path(named)
    yield from sorted(files_of(task, "checkpoints").glob("*"))
    yield from own_checkpoints()


SOLVERS = ("emulator", "naf")


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
    from sim.solvers.simulating import simulating

    with simulating("naf").in_session(own.task, checkpoint.naf, workers, folder) as solver:
        yield solver, solver if checkpoint.naf else own
