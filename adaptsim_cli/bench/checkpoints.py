"""The task and the checkpoint that the settings name, and the checkpoints that there are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli import config
from adaptsim_cli.config import Config

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.tasks.task import Task


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
