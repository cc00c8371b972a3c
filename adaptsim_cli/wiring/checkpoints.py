"""Finds the checkpoint of the settings, lists checkpoints, and verifies their cards."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli.config import Config, load, places
from sim.tasks.task import Task

if TYPE_CHECKING:
    from adaptsim_cli.session.store import SessionStore
    from sim.adaptation.checkpoint import Checkpoint

ROLLOUTS, QUICK = 240, 96
"""True rollouts of a verification: half a minute of one core, and about ten seconds."""


def task_of(config: Config) -> Task:
    """The task of the settings, with the ranges of an own object. Raises UnknownName, ObjectError."""
    from sim.tasks import get_task
    from sim.tasks.own_object import load_object, with_ranges

    task = get_task(config.task)
    return with_ranges(task, load_object(Path(config.object))) if config.object else task


def checkpoint_of(config: Config) -> Checkpoint:
    """The checkpoint that the settings name; else the newest one for the ranges of an own object; else the shipped one.

    Raises UnknownName, ObjectError, CheckpointError.
    """
    from sim.adaptation.checkpoint import load_checkpoint

    task = task_of(config)
    own = _pretrained(task) if config.object and not config.checkpoint else []
    return load_checkpoint(task, config.checkpoint or (str(own[-1]) if own else "default"))


def own_checkpoints() -> list[Path]:
    """Folders of the checkpoints that `adaptsim pretrain` made in its default place, newest last."""
    from sim.adaptation.card import CARD

    cards = places().pretraining.glob(f"*/checkpoint/{CARD}")
    return [card.parent for card in sorted(cards, key=lambda card: card.stat().st_mtime_ns)]


def _pretrained(task: Task) -> list[Path]:
    """The own checkpoints for exactly these ranges."""
    from sim.adaptation.checkpoint import read_card
    from sim.errors import CheckpointError
    from sim.tasks.fingerprint import fingerprint

    def fits(folder: Path) -> bool:
        try:
            return read_card(folder, task.name).fingerprint == fingerprint(task)
        except CheckpointError:
            return False

    return [folder for folder in own_checkpoints() if fits(folder)]


def verify_figures(config: Config, rollouts: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Load the settings' checkpoint, compare it with card and task, and measure the card's figures again; for JSON.

    Raises CheckpointError if it is corrupt or of another task. `holds` says whether the figures hold.
    """
    from sim.pretraining.verification.figures import Figure
    from sim.pretraining.verification.figures import verify_figures as verify
    from sim.rollouts import process_pool, run_many

    checkpoint = checkpoint_of(config)
    task = checkpoint.solver.task
    figures: list[Figure] = []
    if rollouts:
        with process_pool(config.workers or None) as executor:
            roll = partial(run_many, task, executor=executor)
            figures = verify(checkpoint, roll, rollouts, config.seed, progress)
    return {
        "task": task.name,
        "folder": str(checkpoint.path),
        "sha256": checkpoint.sha256,
        "holds": all(f.holds for f in figures),
        "figures": [
            {
                "name": f.name,
                "card": f.card,
                "found": f.found,
                "tolerance": f.tolerance,
                "better": f.better,
                "holds": f.holds,
            }
            for f in figures
        ],
    }


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


def checkpoint_card(task: str, folder: Path) -> dict[str, Any]:
    """The card of a checkpoint, ready for JSON: null for a figure that is not a number. Raises CheckpointError."""
    from sim.adaptation.checkpoint import read_card

    text = json.dumps(read_card(folder, task).facts(), default=str)
    card: dict[str, Any] = json.loads(text, parse_constant=lambda _: None)
    return card


def tell_parameters(config: Config, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Which parameters a session with the settings' checkpoint can identify, for JSON. Raises CheckpointError."""
    from sim.adaptation.identifiability import SESSIONS, TRIALS, identifiability
    from sim.adaptation.methods.adaptsim import create

    checkpoint = checkpoint_of(config)
    task = checkpoint.solver.task
    found = identifiability(create(task, checkpoint).simulators, config.seed, progress)
    return {
        "folder": str(checkpoint.path),
        "task": task.name,
        "sessions": SESSIONS,
        "trials": TRIALS,
        "parameters": [
            {"name": one.name, "title": d.title, "left": one.left, "words": one.words}
            for one, d in zip(found, task.parameters.dimensions, strict=True)
        ],
    }


def checkpoint_of_session(store: SessionStore) -> Checkpoint:
    """The checkpoint that a stored session was begun with, found by the hash of its weights.

    Raises CheckpointError if it is neither a shipped one, nor that of the settings, nor one of the user's own.
    """
    from sim.adaptation.checkpoint import load_checkpoint, read_card
    from sim.errors import CheckpointError

    facts = store.facts
    task = task_of(load().config.model_copy(update={"task": facts.task, "object": facts.object}))
    for folder in _folders(facts.task):
        try:
            if read_card(folder, task.name).sha256 == facts.checkpoint_sha256:
                return load_checkpoint(task, str(folder))
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
