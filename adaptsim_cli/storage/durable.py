"""Writing that survives power loss: a file or folder is either whole under its name or not there.

Everything is written under a temporary name (a leading dot), flushed to the disk, renamed, and the
parent folder flushed. What a killed process leaves behind carries the dot and is never read.
"""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from adaptsim_cli.errors import DiskFull, SessionError
from sim.storage.files import flush_file, flush_folder, publish


def write_file(path: Path, content: bytes) -> None:
    """Write `content` as `path`, which must not exist. Raises DiskFull or SessionError."""
    with explained(path):
        _refuse_existing(path)
        temporary = path.with_name(f".{path.name}.writing")
        _write(temporary, content)
        publish(temporary, path)


def replace_file(path: Path, content: bytes) -> None:
    """Write `content` as `path`, in place of what may be there: for what is derived and can be made again."""
    with explained(path):
        temporary = path.with_name(f".{path.name}.writing")
        _write(temporary, content)
        publish(temporary, path)


def write_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a folder of `files` (name -> content) as `path`, which must not exist. Raises DiskFull or SessionError."""
    with explained(path):
        _refuse_existing(path)
        temporary = path.with_name(f".{path.name}.writing")
        if temporary.exists():
            shutil.rmtree(temporary)
        temporary.mkdir(parents=True)
        for name, content in files.items():
            _write(temporary / name, content)
        flush_folder(temporary)
        publish(temporary, path)


def complete_folder(path: Path, derived: Mapping[str, bytes], name: str, record: bytes) -> None:
    """Add what was `derived` from the files of a folder, and then the `record` that says that the folder is complete.

    Both can be done again after a crash in between. Raises DiskFull or SessionError, also where `name` exists already.
    """
    for file, content in derived.items():
        replace_file(path / file, content)
    write_file(path / name, record)


def make_folder(path: Path) -> None:
    """Make `path` and its missing parents, each flushed into its own parent."""
    if not path.is_dir():
        with explained(path):
            make_folder(path.parent)
            path.mkdir(exist_ok=True)
            flush_folder(path.parent)


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    flush_file(path)


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise SessionError(f"{path} exists already, and stored records are never overwritten")


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn the system's errors of writing `path` into DiskFull or SessionError."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull(
                f"the disk is full: {path} could not be written. Everything completed before is safe; "
                "free some space and run the same command again"
            ) from error
        raise SessionError(f"{path} could not be written: {error.strerror}") from error
