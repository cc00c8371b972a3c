"""Keeps sessions in order: notes and tags, archive, deletion, and pruning of recordings.

Sealed records never change: a note has its own file, an archived session moves unchanged, and a pruned recording leaves
a record of its absence.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.outputs.base import Record
from adaptsim_cli.session import records
from adaptsim_cli.session.records import Pruned
from adaptsim_cli.session.store import MOTION, PRUNED, TRIAL, SessionStore, entries, folder_of
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.locking import locked
from sim.storage.files import flush_folder, publish_new

ABOUT = "about.json"
ARCHIVE = "archived-sessions"
RECORDED = (".mcap",)
"""Suffixes of the files that `prune` removes; files that a report needs stay."""

_TAG = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,39}")


class About(Record):
    """about.json: a person's note and tags. The only file of a session that is replaced."""

    note: str = ""  # free text
    tags: tuple[str, ...] = ()  # for `sessions list --tag`


@dataclass(frozen=True)
class Room:
    """The files that pruning removes or has removed."""

    files: int
    bytes: int
    trials: int


def about(folder: Path) -> About:
    """Note and tags of the session in `folder`; empty if there are none. Raises SessionError."""
    path = folder / ABOUT
    return records.read(About, path) if path.exists() else About()


def annotate(folder: Path, note: str | None = None, add: Sequence[str] = (), remove: Sequence[str] = ()) -> About:
    """Replace the note (None: it stays), add and remove tags. Raises UsageError, SessionError."""
    if wrong := [tag for tag in add if not _TAG.fullmatch(tag)]:
        raise UsageError(f"tag {wrong[0]!r}: use letters, digits, '.', '_' and '-' (at most 40)")
    with _held(folder):
        before = about(folder)
        if missing := [tag for tag in remove if tag not in before.tags]:
            known = ", ".join(before.tags) or "none"
            raise UsageError(f"session {folder.name!r} has no tag {missing[0]!r}; tags: {known}")
        kept = tuple(tag for tag in before.tags if tag not in remove)
        tags = tuple(dict.fromkeys((*kept, *add)))
        found = About(note=before.note if note is None else note.strip(), tags=tags)
        durable.replace_file(folder / ABOUT, records.to_json(found))
    return found


def archive_of(root: Path) -> Path:
    """The folder of the archived sessions of `root`."""
    return root.parent / ARCHIVE


def archive(root: Path, name: str) -> Path:
    """Move a session, damaged or not, out of the list; returns its new folder. Raises UsageError, SessionError."""
    return _move(root, archive_of(root), name)


def restore(root: Path, name: str) -> Path:
    """Move an archived session back into the list. Raises UsageError, SessionError."""
    return _move(archive_of(root), root, name)


def delete(root: Path, name: str) -> None:
    """Delete a session for good, whole or not at all. Raises UsageError, SessionError."""
    folder = _existing(root, name)
    gone = folder.with_name(f".{name}.deleted")
    with _held(folder), durable.explained(folder):
        shutil.rmtree(gone, ignore_errors=True)
        folder.rename(gone)
        flush_folder(root)
    shutil.rmtree(gone, ignore_errors=True)


def prunable(store: SessionStore, *, rejected_only: bool = False) -> Room:
    """The room that `prune` would make. Raises SessionError."""
    found = [recorded for _, recorded in _recordings(store, rejected_only=rejected_only)]
    sizes = [path.stat().st_size for recorded in found for path in recorded]
    return Room(len(sizes), sum(sizes), len(found))


def prune(store: SessionStore, *, rejected_only: bool = False) -> Room:
    """Remove the recordings of completed trials and rejected attempts, or of rejected attempts only.

    Records, key moments and reports stay. The removal is recorded first, so that after a crash no recording seems lost.
    Raises SessionError, and UsageError if the session is running.
    """
    with store.locked():
        room = prunable(store, rejected_only=rejected_only)
        at = datetime.now(UTC).isoformat(timespec="seconds")
        for folder, recorded in _recordings(store, rejected_only=rejected_only):
            sizes = {path.name: path.stat().st_size for path in recorded}
            durable.replace_file(folder / PRUNED, records.to_json(Pruned(at=at, files=store.pruned(folder) | sizes)))
            for path in recorded:
                with durable.explained(path):
                    path.unlink()
    return room


def size_bytes(folder: Path) -> int:
    """Size of a session on the disk, in bytes."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _recordings(store: SessionStore, *, rejected_only: bool) -> list[tuple[Path, list[Path]]]:
    """(folder, its recordings) of every trial that does not need its recording to continue."""
    found = []
    existing = store.existing()
    for iteration in range(store.iterations()):
        for folder in entries(store.iteration_folder(iteration)):
            if not (folder / MOTION).exists():
                continue
            is_rejected = any(store.trial_folder(iteration, key) == folder for key in existing.rejected)
            if is_rejected or ((folder / TRIAL).exists() and not rejected_only):
                recorded = [path for path in entries(folder) if path.suffix in RECORDED]
                found += [(folder, recorded)] if recorded else []
    return found


def _move(source: Path, target: Path, name: str) -> Path:
    folder, there = _existing(source, name), target / name
    if there.exists():
        raise UsageError(f"there is a session {name!r} in {target} already: restore or delete that one first")
    durable.make_folder(target)
    with _held(folder), durable.explained(there):
        publish_new(folder, there)
    return there


def _existing(root: Path, name: str) -> Path:
    folder = folder_of(root, name)
    if not folder.is_dir():
        known = ", ".join(entry.name for entry in entries(root)) or "none"
        raise SessionError(f"there is no session {name!r} in {root}; sessions: {known}")
    return folder


def _held(folder: Path) -> AbstractContextManager[None]:
    return locked(folder, f"session {folder.name!r} is being run by another process; wait until that one ends")
