"""Writes files so that a reader sees the whole file or none."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from hw.bounded import Unreadable, read_table, require_tensors
from sim.errors import CheckpointError

TEMPORARY = ".*.writing*"
"""The pattern of temporary names of files and folders."""


def permitted(mode: int) -> int:
    """The permission bits of `mode` that the process's umask leaves, as for any file that a program makes.

    The umask is read from the system's files, because Python can read it only by changing it, which would race with
    other threads.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
        umask = next(int(line.split()[1], 8) for line in lines if line.startswith("Umask:"))
    except (OSError, StopIteration, ValueError):
        umask = 0o022
    return mode & ~umask


@contextlib.contextmanager
def whole_file(path: Path, *, replace: bool = True) -> Iterator[Path]:
    """A temporary path beside `path`: synced to the disk and renamed to `path` at the end, removed on an error.

    Raises OSError; FileExistsError if `path` exists and must not be replaced.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    suffix = f".writing{path.suffix}"
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=suffix, dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        flush_file(temporary)
        temporary.chmod(permitted(0o666))
        (publish if replace else publish_new)(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_toml(path: Path, content: Mapping[str, Any]) -> None:
    """Write a TOML file, whole or not at all. Raises OSError."""
    with whole_file(path) as temporary:
        temporary.write_text(tomli_w.dumps(content), encoding="utf-8")


def read_toml(path: Path) -> dict[str, Any]:
    """Read a table; numbers may be nan. Raises FileNotFoundError, `hw.bounded.Unreadable`."""
    return read_table(path, finite=False)


def sha256(path: Path) -> str:
    """The hex digest of a file's content. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def publish(temporary: Path, path: Path) -> None:
    """Rename a flushed file or folder to its final name, in one step that a power cut cannot divide."""
    os.rename(temporary, path)  # noqa: PTH104 - the atomic step, named as the system call that it is
    flush_folder(path.parent)


def publish_new(temporary: Path, path: Path) -> None:
    """Publish a file and never replace one. Raises FileExistsError, even if another process was first."""
    if path.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    try:
        if temporary.is_dir():
            os.rename(temporary, path)  # noqa: PTH104 - fails on a non-empty folder
        else:
            _link(temporary, path)
    except OSError as error:
        if error.errno == errno.ENOTEMPTY:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        raise
    flush_folder(path.parent)


def _link(temporary: Path, path: Path) -> None:
    """Hard-link, which fails if the name exists; on a file system without hard links, rename."""
    try:
        os.link(temporary, path)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK):
            raise
        os.rename(temporary, path)  # noqa: PTH104


def flush_file(path: Path) -> None:
    """Returns once the content of `path` is on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def flush_folder(path: Path) -> None:
    """Returns once the names in `path` are on the disk, because a rename is durable only after that.

    A file system that cannot flush a folder (FAT, exFAT, some network shares) is left to its own order.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS):
            raise
    finally:
        os.close(descriptor)


Tensors = Mapping[str, NDArray[Any]]


def save_tensors(path: Path, tensors: Tensors) -> None:
    """Write a safetensors file, whole or not at all. Raises OSError."""
    with whole_file(path) as temporary:
        save_file({name: np.asarray(t, order="C") for name, t in tensors.items()}, temporary)


def load_tensors(path: Path) -> dict[str, NDArray[Any]]:
    """The tensors of a file from any source. Raises CheckpointError."""
    try:
        require_tensors(path)
        return dict(load_file(path))
    except Unreadable as error:
        raise CheckpointError(f"{path} {error}: make it again") from error
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}): make it again") from error
