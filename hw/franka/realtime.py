"""The real-time properties that a process needs in order to answer an arm at 1 kHz."""

from __future__ import annotations

import ctypes
import os
import re
import resource
from pathlib import Path

from hw.errors import DeviceUnavailable

PRIORITY = 80
"""Above the network card's interrupt threads (50), below the kernel's watchdogs (99)."""
HIGHEST = 99
"""The priority that libfranka takes by itself: pylibfranka's as it connects, the Panda's as it starts every control."""

KERNEL_FLAG = Path("/sys/kernel/realtime")
_PREEMPT_RT = re.compile(r"\bPREEMPT[_ ]RT\b")


def kernel_has_flag(flag: Path = KERNEL_FLAG) -> bool:
    """Whether the file under /sys says that the kernel is PREEMPT_RT. libfranka looks at nothing else."""
    try:
        return flag.read_text().strip() == "1"
    except OSError:
        return False


def kernel_is_real_time(flag: Path = KERNEL_FLAG, version: str | None = None) -> bool:
    """Whether the running kernel is PREEMPT_RT, according to that file or to `version` (None: `uname -v` of this
    computer).

    The file came with the patches. Kernels since 6.12 may be PREEMPT_RT without them, and then have no such file.
    """
    return kernel_has_flag(flag) or bool(_PREEMPT_RT.search(os.uname().version if version is None else version))


def priority() -> int:
    """The real-time priority of the calling thread; 0 if it has none."""
    return os.sched_getparam(0).sched_priority


def claim(flag: Path = KERNEL_FLAG) -> None:
    """Give this process real-time priority. Raises DeviceUnavailable naming the missing kernel or permission."""
    if not kernel_is_real_time(flag):
        raise DeviceUnavailable(
            f"the running kernel {os.uname().release} is not a real-time one, and late cycles abort motions: neither "
            f"{flag} nor `uname -v` ({os.uname().version}) says PREEMPT_RT; install one (on Debian: apt install "
            "linux-image-rt-amd64), start the computer with it (docs/guide/arms.md)"
        )
    take_priority()


def take_priority() -> None:
    """Raise or lower the priority of the calling thread to `PRIORITY`. Raises DeviceUnavailable without permission."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError as error:
        raise DeviceUnavailable(
            f"no permission for real-time priority {PRIORITY} ({error}); give your user 'rtprio 99' and "
            "'memlock unlimited' in /etc/security/limits.d/realtime.conf, then log in again (docs/guide/arms.md)"
        ) from error


LATENCY = Path("/dev/cpu_dma_latency")
"""Keeps the processor out of its sleep states while it is open with a 0 written to it (kernel: PM QoS)."""
ISOLATED = Path("/sys/devices/system/cpu/isolated")
"""The cores that the kernel was booted to keep free of other processes."""
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_LEAST_LOCKED_BYTES = 2**30
"""Everything that the player maps, libraries included, must fit; a smaller limit would fail during a motion."""


def settle(latency: Path = LATENCY, isolated: Path = ISOLATED) -> tuple[str, ...]:
    """Lock and touch this process's memory, bind it to one core, and keep the processor awake while it lives.

    Call it once, after everything is loaded. Returns a sentence for each of these three steps that the computer does
    not permit. Motions work without them, perhaps with a lower success rate.
    """
    return tuple(filter(None, (_lock_memory(), _keep_to_a_core(isolated), _stay_awake(latency))))


def _lock_memory() -> str:
    allowed, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    hint = "give your user 'memlock unlimited' (docs/guide/arms.md)"
    if os.geteuid() != 0 and allowed != resource.RLIM_INFINITY and allowed < _LEAST_LOCKED_BYTES:
        return f"the player's memory is not locked ({allowed / 2**20:.0f} MB are allowed): {hint}"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:  # this also touches every page
        return f"the player's memory is not locked ({os.strerror(ctypes.get_errno())}): {hint}"
    return ""


def _keep_to_a_core(isolated: Path) -> str:
    cores = sorted(os.sched_getaffinity(0))
    apart = [core for core in _listed(isolated) if core in cores]
    if len(cores) == 1:
        return "the player shares the only core with everything else: give it a computer of two cores or more"
    try:
        os.sched_setaffinity(0, {apart[-1] if apart else cores[-1]})
    except OSError as error:
        return f"the player is not bound to a core ({error.strerror}): it may be moved in the middle of a motion"
    return ""


def _listed(file: Path) -> list[int]:
    """The cores in a list such as 2-3,5; none if the file does not exist."""
    try:
        parts = [part.split("-") for part in file.read_text().strip().split(",") if part]
    except OSError:
        return []
    return [core for part in parts for core in range(int(part[0]), int(part[-1]) + 1)]


def _stay_awake(latency: Path) -> str:
    try:
        held = os.open(latency, os.O_WRONLY | os.O_CLOEXEC)  # kept open until the process ends
        os.write(held, bytes(4))
    except OSError as error:
        return (
            f"the processor may fall asleep between two cycles ({latency}: {error.strerror}): write "
            f'KERNEL=="{latency.name}", GROUP="realtime", MODE="0660" into /etc/udev/rules.d/60-realtime.rules'
        )
    return ""
