"""The share of a computer that a process uses: its cores, and the memory that it returns to the system."""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_PICTURE, _KEPT = 5 * 2**19, 2**26
"""The bytes that the heap may keep for the next array: somewhat less than a colour picture."""
_V2, _V1 = Path("sys/fs/cgroup"), Path("sys/fs/cgroup/cpu")


def usable_cores(system: Path = Path("/")) -> int:
    """The cores that the process may run on (its affinity), or the quota of its control groups if that is less.

    A batch system or a container grants a part of a computer, while `os.cpu_count` counts all of it. `system` is the
    folder that holds `proc` and `sys`.
    """
    cores = len(os.sched_getaffinity(0))
    return max(1, min([cores, *(math.ceil(quota) for quota in _quotas(system))]))


def _quotas(system: Path) -> Iterator[float]:
    """The quota in cores of each control group that this process is in, from its own up to the outermost (cgroups(7)).

    Inside a container, the group's path may be that of the host. A folder that does not exist states no quota.
    """
    try:
        lines = (system / "proc/self/cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        number, _, rest = line.partition(":")
        controllers, _, group = rest.partition(":")
        if number == "0":
            root, read = system / _V2, _quota_v2
        elif "cpu" in controllers.split(","):
            root, read = system / _V1, _quota_v1
        else:
            continue
        inner = PurePosixPath(group.lstrip("/"))
        for folder in (inner, *inner.parents):
            with suppress(OSError, ValueError):  # no such file, or "max": no quota here
                yield read(root / folder)


def _quota_v2(folder: Path) -> float:
    quota, period = (folder / "cpu.max").read_text(encoding="utf-8").split()
    return int(quota) / int(period)


def _quota_v1(folder: Path) -> float:
    quota, period = (
        int((folder / name).read_text(encoding="utf-8")) for name in ("cpu.cfs_quota_us", "cpu.cfs_period_us")
    )
    if quota < 0:
        raise ValueError("no quota")
    return quota / period


def return_pictures() -> None:
    """Have the memory of a picture returned when it is freed, not kept by its thread. This saves 100 MB in a session.

    Without glibc nothing happens.
    """
    with suppress(AttributeError, OSError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_MMAP_THRESHOLD, _PICTURE)
        libc.mallopt(_M_TRIM_THRESHOLD, _KEPT)


def trim() -> None:
    """Return all memory that is free at this moment. Without glibc nothing happens."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
