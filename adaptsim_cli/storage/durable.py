"""Writing that survives power loss: a file or folder is either whole under its name or not there.

Everything is written under a temporary name with a leading dot, flushed to the disk and renamed; then the parent folder
is flushed. A killed process leaves such names behind; they are never read, and `remove_leftovers` removes them. A
record is sealed too, which reveals a later change: its file ends with the SHA-256 of everything before.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from adaptsim_cli.errors import DiskFull, SessionError, UsageError
from hw.extras import installed
from sim.storage.files import TEMPORARY, flush_file, flush_folder, permitted, publish_new, whole_file

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of the system for a full disk or an exhausted quota."""


def write_file(path: Path, content: bytes) -> None:
    """Write `content` as `path`, which must not exist. Raises DiskFull or SessionError."""
    with explained(path), whole_file(path, replace=False) as temporary:
        temporary.write_bytes(content)


def replace_file(path: Path, content: bytes) -> None:
    """Write or replace `path`; only for derived files that can be made again."""
    with explained(path), whole_file(path) as temporary:
        temporary.write_bytes(content)


def require_new(path: Path, *, force: bool) -> None:
    """Raise UsageError if `path` exists, unless the operator said --force."""
    if path.exists() and not force:
        raise UsageError(f"{path} exists already: give another --out, or --force to replace it")


def write_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a folder of `files` (name -> content) as `path`, which must not exist. Raises DiskFull or SessionError."""
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".writing", dir=path.parent))
        try:
            for name, content in files.items():
                (temporary / name).write_bytes(content)
                flush_file(temporary / name)
            temporary.chmod(permitted(0o777))
            flush_folder(temporary)
            publish_new(temporary, path)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def complete_folder(path: Path, derived: Mapping[str, bytes], name: str, record: bytes) -> None:
    """Add files `derived` from those of a folder, then the `record` that marks the folder as complete.

    After a crash in between, both can be repeated. Raises DiskFull or SessionError, also if `name` already exists.
    """
    for file, content in derived.items():
        replace_file(path / file, content)
    write_file(path / name, record)


def make_folder(path: Path) -> None:
    """Make `path` and its missing parents, each flushed into its own parent."""
    if not path.is_dir():
        if path.exists():
            raise SessionError(f"{path} is a file, but a folder is needed; give another place")
        with explained(path):
            make_folder(path.parent)
            path.mkdir(exist_ok=True)
            flush_folder(path.parent)


def remove_leftovers(folder: Path) -> None:
    """Remove unfinished files of killed processes in `folder`. The caller must hold the folder's lock."""
    for path in folder.rglob(TEMPORARY):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):  # never read, so it may stay
                path.unlink()


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn system errors while writing `path` into DiskFull or SessionError."""
    try:
        yield
    except FileExistsError as error:
        raise SessionError(f"{path} exists already, and stored records are never overwritten") from error
    except OSError as error:
        if error.errno in FULL:
            raise disk_full(path) from error
        raise SessionError(
            f"{path} could not be written: {error.strerror}. Everything completed before is safe; check the disk and "
            "its permissions (ADAPTSIM_HOME names another place for all data), then run the same command again"
        ) from error


def disk_full(path: Path) -> DiskFull:
    """The error for a disk without room for `path`."""
    return DiskFull(
        f"the disk is full: {path} could not be written. Everything completed before is safe; "
        "free some space and run the same command again"
    )


LOCK = ".lock"

"""The locked file in the folder, open for writing, because a network file system locks nothing else."""

_POLL_S = 0.02


def version_of(path: Path) -> tuple[int, int] | None:
    """Time and size of a file or folder, which change when it is written; None if it does not exist."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size


@contextmanager
def locked(
    folder: Path, refusal: str, wait_s: float = 0.0, *, file: str = LOCK, kind: int = fcntl.LOCK_EX
) -> Iterator[None]:
    """Lock the existing `folder`; with LOCK_SH as `kind`, against exclusive locks.

    Raises UsageError with the message `refusal` if another process still holds the lock after `wait_s`, DiskFull or
    SessionError if the folder is not writable, or was moved or deleted meanwhile.
    """
    try:
        descriptor = os.open(folder / file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except FileNotFoundError as error:
        raise _gone(folder) from error
    except OSError as error:
        if error.errno in FULL:
            raise disk_full(folder / LOCK) from error
        raise SessionError(f"{folder} cannot be locked: {error.strerror}; check that you may write there") from error
    try:
        _lock(descriptor, folder / file, kind, refusal, time.monotonic() + wait_s)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, file: Path, kind: int, refusal: str, until_s: float) -> None:
    while True:
        try:
            fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() >= until_s:
                raise UsageError(refusal) from error
            time.sleep(_POLL_S)
        except OSError as error:
            raise SessionError(
                f"{file.parent} is on a file system without locks ({error.strerror}), so two commands could change it "
                "at once: set ADAPTSIM_HOME to a folder on a local disk"
            ) from error
        else:
            break
    if not _is_file_of(descriptor, file):  # the folder was moved between opening and locking
        raise _gone(file.parent)


def _is_file_of(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _gone(folder: Path) -> SessionError:
    return SessionError(f"{folder} is not there any more: another process has just moved or deleted it")


_JSON = (b',\n "sealed": "', b'"\n}\n')
_TOML = (b"# sha256 ", b"\n")
_DIGITS = 64

SEAL = "sealed"
"""The key of the seal in a JSON file. In a TOML file the seal is a comment."""


class SealBroken(ValueError):
    """A file was changed after it was written."""


def seal_json(text: bytes) -> bytes:
    """Indented JSON of an object, sealed."""
    return _sealed(text.removesuffix(b"\n}\n"), _JSON)


def seal_toml(text: bytes) -> bytes:
    """TOML, sealed."""
    return _sealed(text, _TOML)


def require_seal(content: bytes, suffix: str) -> None:
    """Raises SealBroken unless a file of this suffix ends with its seal, and the seal fits its content."""
    before, after = _TOML if suffix == ".toml" else _JSON
    start = len(content) - len(before) - _DIGITS - len(after)
    if start < 0 or content[start : start + len(before)] != before or not content.endswith(after):
        raise SealBroken("has lost its checksum")
    if content != _sealed(content[:start], (before, after)):
        raise SealBroken("was changed after it had been written: its SHA-256 is another")


def _sealed(body: bytes, frame: tuple[bytes, bytes]) -> bytes:
    before, after = frame
    return body + before + hashlib.sha256(body).hexdigest().encode() + after


_VERSIONED = ("adaptsim", "drake", "numpy", "opencv-python-headless")


def versions() -> dict[str, str]:
    """The versions of Python and of the packages that results depend on."""
    return {"python": platform.python_version(), **installed(*_VERSIONED)}
