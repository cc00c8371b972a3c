"""One process at a time: a lock on a folder, which the system releases if the process is killed."""

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
"""The locked file in the folder, open for writing, because a network file system locks nothing else."""

_POLL_S = 0.02


@contextmanager
def locked(folder: Path, taken: str, wait_s: float = 0.0) -> Iterator[None]:
    """Lock the existing `folder`.

    Raises UsageError with the message `taken` if another process still holds the lock after `wait_s`, DiskFull or
    SessionError if the folder is not writable, or was moved or deleted meanwhile.
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
    if not _is_file_of(descriptor, folder / LOCK):  # the folder was moved between opening and locking
        raise _gone(folder)


def _is_file_of(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _gone(folder: Path) -> SessionError:
    return SessionError(f"{folder} is not there any more: another process has just moved or deleted it")
