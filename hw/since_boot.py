"""The clock for freshness: it goes on while the computer sleeps, so nothing said before looks new afterwards."""

from __future__ import annotations

import time


def since_boot_s() -> float:
    """Seconds since the computer started, its sleep included (`time.monotonic` leaves that out on Linux)."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)
