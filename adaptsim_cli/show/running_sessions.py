"""The sessions that a command runs at this moment, without touching them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from adaptsim_cli.session.folders import names
from adaptsim_cli.storage.durable import LOCK

LOCKS = Path("/proc/locks")
"""Every lock that a process of this computer holds."""


def running(root: Path) -> tuple[str, ...]:
    """The names of the sessions below `root` whose lock is held, newest last.

    The kernel's list of locks is read, because trying a lock would refuse a command that begins at the same moment.
    """
    held = _held_inodes()
    chosen = []
    for name in names(root) if held else ():
        with suppress(OSError):
            if (root / name / LOCK).stat().st_ino in held:
                chosen.append(name)
    return tuple(chosen)


def _held_inodes() -> set[int]:
    """The files that are locked as a whole (flock), by inode: file systems disagree about the device."""
    try:
        lines = LOCKS.read_text(encoding="ascii").splitlines()
    except OSError:  # a system without it: nothing is shown as running
        return set()
    fields = (line.split() for line in lines if " FLOCK " in line and "->" not in line)
    return {int(one[5].rpartition(":")[2]) for one in fields}
