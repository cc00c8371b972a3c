"""What the computer must give a process that speaks to an arm a thousand times a second."""

from __future__ import annotations

import os
from pathlib import Path

from hw.errors import DeviceUnavailable

PRIORITY = 80
"""Above the network card's interrupt threads (50), below the kernel's watchdogs (99)."""

KERNEL_FLAG = Path("/sys/kernel/realtime")


def kernel_is_real_time(flag: Path = KERNEL_FLAG) -> bool:
    """Whether the running kernel is a PREEMPT_RT one (it says so under /sys, as libfranka asks)."""
    try:
        return flag.read_text().strip() == "1"
    except OSError:
        return False


def claim(flag: Path = KERNEL_FLAG) -> None:
    """Give this process real-time priority. Raises DeviceUnavailable with what the computer lacks."""
    if not kernel_is_real_time(flag):
        raise DeviceUnavailable(
            f"the running kernel {os.uname().release} is not a real-time one, and late cycles abort motions; "
            "install one (on Debian: apt install linux-image-rt-amd64), start the computer with it (docs/guide/arms.md)"
        )
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError as error:
        raise DeviceUnavailable(
            f"no permission for real-time priority {PRIORITY} ({error}); give your user 'rtprio 99' and "
            "'memlock unlimited' in /etc/security/limits.d/realtime.conf, then log in again (docs/guide/arms.md)"
        ) from error
