"""The task and the checkpoint that the settings name, and the list of all checkpoints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptsim_cli import config
from adaptsim_cli.config import Config, Resolved

if TYPE_CHECKING:
    from adaptsim_cli.trust import FileClaim
    from sim.adaptation.checkpoint import Checkpoint
    from sim.tasks.task import Task


DEFAULT = "default"
"""The shipped checkpoint of a task."""


def resolve(flags: Mapping[str, Any] | None = None) -> Resolved:
    """The settings, with the name of the task that a file declares. Raises UsageError, UnknownName, TaskError.

    If nothing names a world, and the task of a file has no world with the default name, its first world is used.
    """
    resolved = config.load(flags)
    named = resolved.config.task
    if named.partition(":")[0].endswith(".py"):
        from sim.tasks import task_of_file

        _require_trusted(resolved)
        task = task_of_file(named)
        return _in_a_world(resolved, task.name, tuple(task.worlds))
    if (resolved.places.data / "tasks" / f"{named}.toml").is_file():
        from sim.tasks.files import registered

        entry = registered().get(named)
        return _in_a_world(resolved, named, entry.worlds if entry else ())
    return resolved


def _in_a_world(resolved: Resolved, task: str, worlds: tuple[str, ...]) -> Resolved:
    values, sources = {"task": task}, dict(resolved.sources)
    if sources["world"] == "default" and worlds and resolved.config.world not in worlds:
        values["world"], sources["world"] = worlds[0], f"the first world of {task}"
    return replace(resolved, config=resolved.config.model_copy(update=values), sources=sources)


def task_claims(resolved: Resolved) -> tuple[FileClaim, ...]:
    """The task file that the current folder's settings name. It may be somebody else's, and its code runs when it is
    read.
    """
    from adaptsim_cli.trust import TASK, FileClaim

    named = resolved.config.task
    file = Path(named.rpartition(":")[0] or named)
    if resolved.sources["task"] != str(resolved.places.project_file) or file.suffix != ".py":
        return ()
    return (FileClaim.of_files(TASK, [file], f"Reading it runs its code, as {resolved.places.project_file} asks."),)


def _require_trusted(resolved: Resolved) -> None:
    """Raises UsageError for a task file of the current folder's settings that nobody has confirmed."""
    if claims := task_claims(resolved):
        from adaptsim_cli import trust
        from adaptsim_cli.screen.console import Screen

        confirmed = trust.Trust(resolved.places.trust_file)
        trust.require(claims, confirmed, Screen(), asks=False, command="adaptsim config trust")


def task_of(settings: Config) -> Task:
    """The task of the settings, with the ranges of an own object. Raises UnknownName, ObjectError."""
    from sim.tasks.own_object import task_of_object

    return task_of_object(settings.task, settings.object)


def checkpoint_of(settings: Config) -> Checkpoint:
    """The checkpoint that the settings name; else the newest one for the ranges of an own object; else the shipped one,
    or the newest own one of a task that ships none.

    A checkpoint for other ranges is never used for an own object. Raises UnknownName, ObjectError, CheckpointError.
    """
    from sim.adaptation.checkpoint import load_checkpoint
    from sim.errors import CheckpointError

    task = task_of(settings)
    if not settings.object or settings.checkpoint:
        return load_checkpoint(task, settings.checkpoint or usual_checkpoint(task))
    if not (fitting := _pretrained(task)):
        raise CheckpointError(
            f"nothing is pretrained for the ranges of {settings.object} yet: adaptsim pretrain {settings.same_task}"
        )
    return load_checkpoint(task, str(fitting[-1]))


def usual_checkpoint(task: Task) -> str:
    """The name of the shipped checkpoint; if there is none, the folder of the user's newest pretrained checkpoint."""
    from sim.adaptation.card import CARD
    from sim.tasks import files_of

    if (files_of(task.name, "checkpoints") / DEFAULT / CARD).exists():
        return DEFAULT
    own = [folder for folder in own_checkpoints() if _is_of(folder, task)]
    fitting = [folder for folder in own if folder in _pretrained(task)]
    return str((fitting or own)[-1]) if own else DEFAULT


def _is_of(folder: Path, task: Task) -> bool:
    from sim.adaptation.card import read_card
    from sim.errors import CheckpointError

    try:
        return read_card(folder, task.name).task == task.name
    except CheckpointError:
        return False


def own_checkpoints() -> list[Path]:
    """Folders of the checkpoints that `adaptsim pretrain` made in its default place, newest last."""
    from sim.adaptation.card import CARD

    cards = config.places().pretraining.glob(f"*/checkpoint/{CARD}")
    return [card.parent for card in sorted(cards, key=lambda card: card.stat().st_mtime_ns)]


def _pretrained(task: Task) -> list[Path]:
    """The checkpoints for exactly these ranges, the newest own one last."""
    from sim.adaptation.card import read_card
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
    from sim.adaptation.card import list_checkpoints, read_card
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
