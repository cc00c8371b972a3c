"""Stored rollouts: single trials that belong to no session. Reading only."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from adaptsim_cli.errors import SessionError
from adaptsim_cli.outputs.sessions import DamagedRollout, RolloutRow
from adaptsim_cli.outputs.trials import Rollout
from adaptsim_cli.session.keeping import size_bytes
from adaptsim_cli.session.records import corrupt, read_object
from adaptsim_cli.session.store import TRIAL, entries, folder_of
from adaptsim_cli.storage.validation import explained

FOLDER = "rollouts"


def names(root: Path) -> tuple[str, ...]:
    """The rollouts in `root`, newest last: their names begin with the task and the time."""
    folders = [entry for entry in entries(root) if entry.is_dir()]
    return tuple(folder.name for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime_ns))


def record_of(root: Path, name: str) -> Rollout:
    """The record of one. Raises SessionError if it is missing, incomplete or corrupt, UsageError on a wrong name."""
    folder = folder_of(root, name)
    if not folder.is_dir():
        known = ", ".join(names(root)) or "none yet"
        raise SessionError(f"there is no rollout {name!r} in {root}; rollouts: {known}")
    path = folder / TRIAL
    if not path.is_file():
        raise SessionError(f"rollout {name} was not tracked: {folder} holds its recording, and no {TRIAL}")
    try:
        return Rollout.model_validate(read_object(path))
    except ValidationError as error:
        raise corrupt(path, explained(error)) from error


def overview(root: Path, name: str) -> RolloutRow | DamagedRollout:
    """One rollout in one line; a damaged one with its error, so that the list still shows the others."""
    try:
        record = record_of(root, name)
    except SessionError as error:
        return DamagedRollout(rollout=name, error=str(error))
    kept = record.model_dump(include=set(RolloutRow.model_fields))
    return RolloutRow(rollout=name, size_bytes=size_bytes(root / name), folder=str(root / name), **kept)
