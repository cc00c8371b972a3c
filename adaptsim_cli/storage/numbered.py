"""Numbered folders of one kind, from 1. The one with the highest number counts, and none is ever overwritten."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.storage import durable
from calib.errors import ViewFolderError
from calib.records import read
from hw.bounded import Unreadable, read_table
from hw.records import Record

RESTORED = "restored.json"
"""The file beside a restored copy, with the original's name and the time."""


@dataclass(frozen=True)
class Numbered:
    """`<folder>/<prefix>0001`, `0002` ..."""

    folder: Path
    prefix: str  # "calibration-"

    def all(self) -> list[Path]:
        """Every one, oldest first."""
        pattern = re.compile(re.escape(self.prefix) + r"\d{4,}")
        return sorted(path for path in self.folder.glob(f"{self.prefix}*") if pattern.fullmatch(path.name))

    def next(self) -> Path:
        """The path of the next one."""
        paths = self.all()
        number = int(paths[-1].name.removeprefix(self.prefix)) + 1 if paths else 1
        return self.folder / f"{self.prefix}{number:04d}"

    def named(self, name: str) -> Path:
        """The folder with this name or number. Raises UsageError naming the existing ones."""
        full_name = f"{self.prefix}{int(name):04d}" if name.isdigit() else name
        by_name = {path.name: path for path in self.all()}
        if full_name not in by_name:
            raise UsageError(f"there is no {full_name} in {self.folder}; there are: {', '.join(by_name) or 'none yet'}")
        return by_name[full_name]

    def restore(self, name: str, at: str) -> Path:
        """Put an earlier one in use again, as a copy with the next number.

        Raises UsageError, DiskFull, SessionError.
        """
        source, target = self.named(name), self.next()
        if source == self.all()[-1]:
            raise UsageError(f"{source.name} is in use already")
        files = {entry.name: entry.read_bytes() for entry in sorted(source.iterdir()) if entry.is_file()}
        note = {"from": source.name, "at": at}
        durable.write_folder(target, files | {RESTORED: json.dumps(note).encode()})
        return target


AnyRecord = TypeVar("AnyRecord", bound=Record)


@dataclass(frozen=True)
class NumberedRecords(Generic[AnyRecord]):
    """Numbered folders in `folder`, each with one record; the latest is in use."""

    folder: Path
    kind: ClassVar[type[Record]]
    file: ClassVar[str]  # of the record
    prefix: ClassVar[str]
    command: ClassVar[str]  # `adaptsim COMMAND` makes one, `adaptsim COMMAND restore` goes back to an earlier one

    @property
    def numbered(self) -> Numbered:
        """The folders by name."""
        return Numbered(self.folder, self.prefix)

    def read(self, path: Path) -> AnyRecord:
        """The record in one of the folders. Raises SessionError if it is unreadable."""
        try:
            return read(self.kind, path / self.file)  # type: ignore[return-value]
        except ViewFolderError as error:
            raise SessionError(str(error)) from error

    def current(self) -> AnyRecord | None:
        """The latest one. Raises SessionError if it is unreadable: an older one is never used silently."""
        paths = self.numbered.all()
        try:
            return self.read(paths[-1]) if paths else None
        except SessionError as error:
            raise SessionError(
                f"{error}. Go back to an earlier one: adaptsim {self.command} restore; or make another: adaptsim "
                f"{self.command}"
            ) from error

    def listed(self, summary: Callable[[AnyRecord, Path], Mapping[str, Any]]) -> list[dict[str, Any]]:
        """One row per folder, oldest first, with the `summary` of its record; a damaged one has its error."""
        rows: list[dict[str, Any]] = []
        for path in (paths := self.numbered.all()):
            try:
                row = summary(self.read(path), path)
            except SessionError as error:
                rows.append({"name": path.name, "error": str(error)})
                continue
            in_use = {"in_use": path == paths[-1], "restored_from": restored_from(path)}
            rows.append({"name": path.name, **row, **in_use})
        return rows

    def add(self, files: Mapping[str, bytes]) -> Path:
        """Store a record's file and others beside it in the next folder. Raises DiskFull, SessionError."""
        durable.make_folder(self.folder)
        path = self.numbered.next()
        durable.write_folder(path, files)
        return path


def restored_from(path: Path) -> str:
    """The name of the original of a copy; "" if `path` is not a copy."""
    try:
        named = read_table(path / RESTORED).get("from")
    except (OSError, Unreadable):
        return ""
    return named if isinstance(named, str) else ""


def remark(in_use: bool, copy_of: str) -> str:
    """The remark in a list: `in use, copy of 1`."""
    copied = f"copy of {int(copy_of.rpartition('-')[2])}" if copy_of else ""
    return ", ".join(part for part in ("in use" if in_use else "", copied) if part)
