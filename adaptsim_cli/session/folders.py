"""The folders of sessions: their names, the newest one, their parts and files."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session import records
from adaptsim_cli.session.records import SessionFacts
from hw.bounded import read_table
from hw.plugins import did_you_mean

FACTS = "session.toml"
REPORT = "report.html"
"""The page of a session."""
OVERLAY = "overlay.jpg"
"""The camera's finding before a motion: in the folder of its trial, and the latest one in that of the session."""
FILM = "film.jpg"
"""The small pictures of a trial, on one sheet, in its folder."""
QUESTIONS = "questions"
"""The folder of the questions to a robot of one's own, and of their answers."""
SOLVER, FORMER_SOLVER = "solver", "naf"
"""The folder of a solver's own files, now and in sessions of earlier versions."""

_ITERATION = re.compile(r"iteration-(\d+)")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def folder_of(root: Path, name: str) -> Path:
    """The folder of session `name`. Raises UsageError if that cannot be a folder's name."""
    if not _NAME.fullmatch(name):
        raise UsageError(f"session name {name!r}: use letters, digits, '.', '_' and '-' (at most 100)")
    return root / name


def existing_folder(root: Path, name: str) -> Path:
    """The folder of a session, damaged or not. Raises SessionError naming the existing ones."""
    folder = folder_of(root, name)
    if not folder.is_dir():
        listing = ", ".join(names(root)) or "none yet"
        near = did_you_mean(name, names(root))
        raise SessionError(f"there is no session {name!r} in {root}; sessions: {listing}{near}")
    alike = [entry.name for entry in entries(root) if entry.name.casefold() == name.casefold()]
    if alike and name not in alike:
        raise SessionError(
            f"there is no session {name!r} in {root}, and its disk does not tell that name from {alike[0]!r}: use "
            f"{alike[0]}, or a name that differs by more than capital letters"
        )
    return folder


def names(root: Path) -> tuple[str, ...]:
    """The sessions below `root`, damaged ones too, newest last. Strays are left out."""
    folders = [entry for entry in entries(root) if entry.is_dir() and _NAME.fullmatch(entry.name)]
    return tuple(folder.name for folder in sorted(folders, key=_begun))


def strays(root: Path) -> tuple[str, ...]:
    """The folders below `root` that cannot be sessions by their names, e.g. `p1 (copy)` and `lost+found`."""
    return tuple(entry.name for entry in entries(root) if entry.is_dir() and not _NAME.fullmatch(entry.name))


def stray_note(root: Path) -> str:
    """One sentence about the strays below `root`; "" without any."""
    stray_names = strays(root)
    if not stray_names:
        return ""
    which = ", ".join(repr(name) for name in stray_names[:5]) + (" and more" if len(stray_names) > 5 else "")
    return (
        f"Skipped in {root}: {which}. The name of a session has letters, digits, '.', '_' and '-' only: rename what "
        "should be one"
    )


def newest(root: Path, without: str = "") -> str:
    """The newest session by another method than `without`. Raises SessionError without one."""
    candidates = [name for name in names(root) if (root / name / FACTS).is_file()]
    if without:
        candidates = [name for name in candidates if records.read(SessionFacts, root / name / FACTS).method != without]
    if not candidates:
        raise SessionError(f"there are no sessions in {root} yet; begin one with adaptsim run-iteration")
    return candidates[-1]


def _begun(folder: Path) -> tuple[float, int]:
    """When a session was begun, in s since 1970 by its own record; for equal seconds, also the time of its folder.

    Copying changes the times of files, so they count only where the record cannot be read.
    """
    file = folder / FACTS
    changed_ns = (file if file.is_file() else folder).stat().st_mtime_ns
    try:
        created_s = datetime.fromisoformat(str(read_table(file)["created"])).timestamp()
    except (OSError, KeyError, ValueError):
        created_s = 1e-9 * changed_ns
    return created_s, changed_ns


@dataclass(frozen=True)
class SessionFolders:
    """The folders in a session's folder, by their contents."""

    iterations: Mapping[int, Path]  # by index from 0, in order
    questions: Path | None
    solver: Path | None
    others: tuple[Path, ...]  # none of this version: of a newer one, or a person's own


def session_parts(folder: Path) -> SessionFolders:
    """The parts of the session in `folder`. A new kind of folder needs a line here, and nowhere else."""
    folders = [entry for entry in entries(folder) if entry.is_dir()]
    numbered = {int(match[1]) - 1: entry for entry in folders if (match := _ITERATION.fullmatch(entry.name))}
    named = {entry.name: entry for entry in folders if not _ITERATION.fullmatch(entry.name)}
    questions, solver = named.pop(QUESTIONS, None), named.pop(solver_folder(folder).name, None)
    return SessionFolders(dict(sorted(numbered.items())), questions, solver, tuple(named.values()))


def solver_folder(folder: Path) -> Path:
    """The folder of the solver's own files in that of a session."""
    former = folder / FORMER_SOLVER
    return former if former.is_dir() else folder / SOLVER


def entries(folder: Path) -> list[Path]:
    """A folder's own folders and regular files in alphabetical order, without leftovers of killed processes.

    Links are not followed and pipes are not opened, because files elsewhere are not part of a session.
    """
    try:
        with os.scandir(folder) as scan:
            names = [entry.name for entry in scan if not entry.name.startswith(".") and _is_own(entry)]
    except (FileNotFoundError, NotADirectoryError):
        return []
    return [folder / name for name in sorted(names)]


def own_files(folder: Path) -> list[Path]:
    """Every regular file in `folder` and in its own folders, by `entries`."""
    files = []
    for entry in entries(folder):
        files += own_files(entry) if entry.is_dir() else [entry]
    return files


def _is_own(entry: os.DirEntry[str]) -> bool:
    return entry.is_file(follow_symlinks=False) or entry.is_dir(follow_symlinks=False)


def size_bytes(folder: Path) -> int:
    """Size of a session on the disk, in bytes."""
    return sum(path.stat().st_size for path in own_files(folder))
