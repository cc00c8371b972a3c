"""Files of the current folder that decide about motions, confirmations or programs: a person confirms each once.

The folder may be somebody else's repository. A confirmation is bound to absolute paths and to the SHA-256 of every file
behind it, and is kept among the user's own settings, never inside the current folder. The page for users:
docs/guide/current-folder.md.
"""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from adaptsim_cli.config import Places
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, stop
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_table

RIG, SETTINGS, PROGRAM, TASK = "rig file", "settings", "program", "task file"
KINDS: Mapping[str, str] = {
    RIG: "where a real arm may move, which devices guard it, and what is confirmed",
    SETTINGS: "which robot makes the trials, at what pace, and with which policies",
    PROGRAM: "which commands run, and whether each trial is confirmed",
    TASK: "which motions a task makes",
}
"""Every kind of file that is confirmed, and what such a file decides."""
MOST_FILES, MOST_BYTES = 2_000, 256 * 2**20
"""A larger folder is not read, and its files are then not covered."""
UNREAD = ".git"
"""Folders of this name are not covered, because version control rewrites its own files at every command."""


class NotCovered(Exception):
    """The files of a folder cannot all be bound; the message says why."""


@dataclass(frozen=True)
class FileClaim:
    """Something of the current folder that counts only once it is confirmed."""

    kind: str  # of KINDS
    place: Path  # absolute: the file, or the folder of a program
    content: Mapping[str, str]  # all that the confirmation is bound to: absolute path, or a word -> SHA-256, or a text
    meaning: str  # its effect, in sentences for the person who confirms it

    @classmethod
    def of_files(cls, kind: str, files: Sequence[Path], meaning: str) -> FileClaim:
        """The claim of single files, named after the first one. Raises UsageError for a file that cannot be read."""
        try:
            content = contents(*(file.absolute() for file in files))
        except NotCovered as error:
            raise UsageError(f"the {kind} {files[0]}: {error}") from error
        return cls(kind, files[0].absolute(), content, meaning)


@dataclass(frozen=True)
class Trust:
    """The confirmations of one user on one computer. A damaged file counts as empty: everything is asked again."""

    file: Path

    def holds(self, claim: FileClaim) -> bool:
        """Whether exactly this was confirmed."""
        return any(_same(entry, claim) and entry.get("content") == dict(claim.content) for entry in self._entries())

    def changes(self, claim: FileClaim) -> tuple[str, ...]:
        """The files or texts that differ from the confirmed ones; none if nothing was ever confirmed."""
        was = next((entry["content"] for entry in self._entries() if _same(entry, claim)), None)
        if not isinstance(was, dict):
            return ()
        return tuple(name for name in sorted({*was, *claim.content}) if was.get(name) != claim.content.get(name))

    def confirm(self, claim: FileClaim) -> None:
        """Keep a confirmation; it replaces an earlier one of the same place. Raises SessionError, DiskFull."""
        at = datetime.now(UTC).isoformat(timespec="seconds")
        new = {"kind": claim.kind, "place": str(claim.place), "on": at, "content": dict(claim.content)}
        entries = [*(entry for entry in self._entries() if not _same(entry, claim)), new]
        durable.make_folder(self.file.parent)
        durable.replace_file(self.file, (json.dumps({"confirmed": entries}, indent=1) + "\n").encode())

    def _entries(self) -> list[dict[str, Any]]:
        try:
            entries = read_table(self.file).get("confirmed")
        except (FileNotFoundError, Unreadable):
            return []
        if not isinstance(entries, list):
            return []
        return [entry for entry in entries if isinstance(entry, dict) and {"kind", "place", "content"} <= entry.keys()]


def require(claims: Iterable[FileClaim], trust: Trust, screen: Screen, *, asks: bool, command: str) -> None:
    """Returns once every claim is confirmed; Enter alone never confirms.

    Raises UsageError with the `command` that asks, if nobody can be asked here; StoppedByOperator at q.
    """
    for claim in claims:
        if trust.holds(claim):
            continue
        title = f"the {claim.kind} {claim.place}"
        changes = trust.changes(claim)
        since = f" Since you confirmed it, this has changed: {_listed(changes)}." if changes else ""
        if not asks:
            raise UsageError(
                f"{title} belongs to the current folder and may be somebody else's. {claim.meaning}{since} It counts "
                f"only once a person has confirmed it, so nothing has run or moved. Confirm it at a terminal: {command}"
            )
        screen.note(f"{title[0].upper()}{title[1:]} belongs to the current folder and may be somebody else's.")
        screen.note(f"  {claim.meaning}{since}")
        yes = Key("y", "to confirm it", "It counts from now on, only here, until its content changes.")
        if screen.choose(f"Do you trust {title}?", yes, stop("The command ends; nothing has run or moved.")) == "q":
            raise StoppedByOperator("stopped by the operator; nothing has run or moved")
        trust.confirm(claim)


def settings_claims(where: Places) -> tuple[FileClaim, ...]:
    """The settings files of the current folder that set anything. Raises UsageError for one that cannot be read."""
    claims = []
    for file in map(Path, where.foreign_settings):
        try:
            table = read_table(file)
        except FileNotFoundError:
            continue
        except Unreadable as error:
            raise UsageError(f"{file} {error}") from error
        if table:
            lines = ", ".join(f"{key} = {json.dumps(value, default=str)}" for key, value in table.items())
            claims.append(FileClaim.of_files(SETTINGS, [file], f"It sets {lines}."))
    return tuple(claims)


def contents(*roots: Path) -> dict[str, str]:
    """Absolute path -> SHA-256 of every file at the `roots` or below them; links are followed, and the links themselves
    are included.

    Raises NotCovered beyond `MOST_FILES` and `MOST_BYTES` in all, and where something cannot be read.
    """
    digests: dict[str, str] = {}
    folders, left, size = set[tuple[int, int]](), [*roots], 0
    while left:
        path = left.pop()
        try:
            if path.is_symlink():
                digests[f"{path} ->"] = str(path.readlink())
            status = path.stat()
            if stat.S_ISDIR(status.st_mode):
                if (key := (status.st_dev, status.st_ino)) not in folders:
                    folders.add(key)
                    left += sorted((entry for entry in path.iterdir() if entry.name != UNREAD), reverse=True)
            elif not stat.S_ISREG(status.st_mode):
                digests[str(path)] = "no file"
            else:
                size += status.st_size
                if size <= MOST_BYTES:
                    with path.open("rb") as file:
                        digests[str(path)] = hashlib.file_digest(file, "sha256").hexdigest()
        except FileNotFoundError:
            digests[str(path)] = "missing"
        except OSError as error:
            raise NotCovered(f"{path} cannot be read: {error.strerror}") from error
        if len(digests) > MOST_FILES or len(left) > MOST_FILES or size > MOST_BYTES:
            named = ", ".join(map(str, roots))
            raise NotCovered(f"{named} holds more than {MOST_FILES} files or {MOST_BYTES // 2**20} MB")
    return digests


def _same(entry: Mapping[str, Any], claim: FileClaim) -> bool:
    return (entry["kind"], entry["place"]) == (claim.kind, str(claim.place))


def _listed(names: Sequence[str], most: int = 3) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
