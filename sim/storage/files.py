"""Writing files so that a reader sees the whole file or none."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import tomli_w


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`: synced to disk and renamed to it at the end, removed on an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        flush_file(temporary)
        temporary.chmod(0o644)
        publish(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_toml(path: Path, content: Mapping[str, Any]) -> None:
    """Write a TOML file that is there whole or not at all. Raises OSError."""
    with whole_file(path) as temporary:
        temporary.write_text(tomli_w.dumps(content), encoding="utf-8")


def read_toml(path: Path) -> dict[str, Any]:
    """Raises OSError or tomllib.TOMLDecodeError."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def sha256(path: Path) -> str:
    """The hex digest of a file's content. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def publish(temporary: Path, path: Path) -> None:
    """Give a file or folder whose content is on the disk its name, in one step that a power cut cannot divide."""
    os.rename(temporary, path)  # noqa: PTH104 - the atomic step, named as the system call that it is
    flush_folder(path.parent)


def flush_file(path: Path) -> None:
    """Returns when the content of `path` is on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def flush_folder(path: Path) -> None:
    """Returns when the names in `path` are on the disk: a rename is there only once its folder is."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
