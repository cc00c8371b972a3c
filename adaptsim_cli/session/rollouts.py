"""Stored rollouts: single trials that belong to no session. Reading only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.keeping import size_bytes
from adaptsim_cli.session.records import corrupt, read_object
from adaptsim_cli.session.store import TRIAL, entries, folder_of

FOLDER = "rollouts"
_NEEDED = ("task", "hw", "world", "outcome", "reward", "context", "action", "track", "when", "flags")


def names(root: Path) -> tuple[str, ...]:
    """The rollouts in `root`, newest last: their names begin with the task and the time."""
    folders = [entry for entry in entries(root) if entry.is_dir()]
    return tuple(folder.name for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime_ns))


def record_of(root: Path, name: str) -> dict[str, Any]:
    """The record of one. Raises SessionError if it is missing, incomplete or corrupt, UsageError on a wrong name."""
    folder = folder_of(root, name)
    if not folder.is_dir():
        known = ", ".join(names(root)) or "none yet"
        raise SessionError(f"there is no rollout {name!r} in {root}; rollouts: {known}")
    path = folder / TRIAL
    if not path.is_file():
        raise SessionError(f"rollout {name} was not tracked: {folder} holds its recording, and no {TRIAL}")
    record = read_object(path)
    if missing := [key for key in _NEEDED if key not in record]:
        raise corrupt(path, f"{missing[0]} is missing")
    return record


def overview(root: Path, name: str) -> dict[str, Any]:
    """One rollout in one line; a damaged one with its name and an error, so that the list still shows the others."""
    try:
        record = record_of(root, name)
    except SessionError as error:
        return {"rollout": name, "error": str(error)}
    kept = ("task", "hw", "world", "outcome", "reward", "context", "action", "when")
    size = size_bytes(root / name)
    return {"rollout": name, **{key: record[key] for key in kept}, "size_bytes": size, "folder": str(root / name)}
