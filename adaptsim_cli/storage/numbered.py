"""Numbered folders of one kind, from 1: the highest counts, and none is ever overwritten."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from adaptsim_cli.errors import UsageError
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_table

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
        found = self.all()
        number = int(found[-1].name.removeprefix(self.prefix)) + 1 if found else 1
        return self.folder / f"{self.prefix}{number:04d}"

    def named(self, name: str) -> Path:
        """The folder with this name or number. Raises UsageError naming the existing ones."""
        wanted = f"{self.prefix}{int(name):04d}" if name.isdigit() else name
        found = {path.name: path for path in self.all()}
        if wanted not in found:
            raise UsageError(f"there is no {wanted} in {self.folder}; there are: {', '.join(found) or 'none yet'}")
        return found[wanted]

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
