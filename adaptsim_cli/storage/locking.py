"""One process at a time: a lock on a folder, which the system takes back from a process that was killed."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.storage.durable import FULL, disk_full

LOCK = ".lock"
"""A file of the folder, open for writing while the lock is held: a network file system locks nothing else."""

_POLL_S = 0.02


@contextmanager
def locked(folder: Path, taken: str, wait_s: float = 0.0) -> Iterator[None]:
    """Hold `folder`, which exists. Raises UsageError with the message `taken` where another process still holds it
    after `wait_s`, DiskFull or SessionError where the folder cannot be written to, or was moved or deleted meanwhile.
    """
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except FileNotFoundError as error:
        raise _gone(folder) from error
    except OSError as error:
        if error.errno in FULL:
            raise disk_full(folder / LOCK) from error
        raise SessionError(f"{folder} cannot be locked: {error.strerror}; check that you may write there") from error
    try:
        _lock(descriptor, folder, taken, time.monotonic() + wait_s)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, folder: Path, taken: str, until_s: float) -> None:
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() >= until_s:
                raise UsageError(taken) from error
            time.sleep(_POLL_S)
        except OSError as error:
            raise SessionError(f"{folder} is on a file system without locks: {error.strerror}") from error
        else:
            break
    if not _is_file_of(descriptor, folder / LOCK):  # it was moved between opening and locking, and is not held here
        raise _gone(folder)


def _is_file_of(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _gone(folder: Path) -> SessionError:
    return SessionError(f"{folder} is not there any more: another process has just moved or deleted it")
