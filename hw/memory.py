"""Unused memory goes back to the system. Without glibc nothing happens."""

from __future__ import annotations

import ctypes
from contextlib import suppress

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_PICTURE, _KEPT = 5 * 2**19, 2**26
"""Bytes: somewhat less than a colour picture; what the heap may keep for the next array."""


def return_pictures() -> None:
    """Return the memory of a freed picture. Otherwise its thread keeps it, which costs 100 MB in a session."""
    with suppress(AttributeError, OSError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_MMAP_THRESHOLD, _PICTURE)
        libc.mallopt(_M_TRIM_THRESHOLD, _KEPT)


def trim() -> None:
    """Return everything that is free at this moment."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
