"""Checks of the machine: disk, real-time kernel, priorities, clock frequency, the network to the arm."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from adaptsim_cli.doctor.finding import Finding, advice, missing, ok
from adaptsim_cli.doctor.readings import Limits, Port, RoundTrips, WriteSpeed
from hw.franka.realtime import PRIORITY

GROUP, DEVICES = "machine", "devices"
SLOW_MB_S = 20.0
"""A trial's recording has about 40 MB, and the operator waits for it."""
SLOW_FLUSH_S = 0.2
LOCKED_MB = 100
"""The lock limit in libfranka's notes, so that a cycle never waits for a memory page."""
MOST_RTT_MS = 0.5
"""Half of a 1 ms cycle; the maker's ping test asks for the same order."""


def disk(folder: str, free_mb: int, least_mb: int) -> Finding:
    """Room for sessions; `least_mb` is the setting min_free_mb."""
    if free_mb < least_mb:
        fix = "remove something there, or set ADAPTSIM_HOME to a larger disk"
        return missing(GROUP, "disk space", f"{free_mb} MB free in {folder}, {least_mb} MB needed (min_free_mb)", fix)
    return ok(GROUP, "disk space", f"{free_mb / 1000:.1f} GB free")


def disk_speed(folder: str, speed: WriteSpeed) -> Finding:
    """How fast `folder` stores data on the disk, and how long a small file takes."""
    if speed.mb_s is None:
        told = f"{folder} cannot be written to: {speed.problem}"
        return missing(GROUP, "disk speed", told, f"sudo chown -R $USER {folder}")
    found = f"{speed.mb_s:.0f} MB/s, a record is safe after {1e3 * speed.flush_s:.0f} ms"
    if speed.mb_s < SLOW_MB_S or speed.flush_s > SLOW_FLUSH_S:
        fix = "set ADAPTSIM_HOME to a local disk: every trial waits for this one"
        return advice(GROUP, "disk speed", f"{found}; recommended: {SLOW_MB_S:g} MB/s, {1e3 * SLOW_FLUSH_S:g} ms", fix)
    return ok(GROUP, "disk speed", found)


def realtime_kernel(release: str, is_real_time: bool) -> Finding:
    """Whether the kernel is real-time; `release` is that of uname."""
    if is_real_time:
        return ok(GROUP, "real-time kernel", release)
    detail = f"{release} is not real-time: the arm stops with communication_constraints_violation when cycles are late"
    fix = "sudo apt-get install -y linux-image-rt-amd64, then boot it (Ubuntu: sudo pro enable realtime-kernel)"
    return missing(GROUP, "real-time kernel", detail, fix)


def priorities(user: Limits) -> Finding:
    """Whether this user may use real-time priority and locked memory."""
    if user.privileged or (user.rtprio >= PRIORITY and user.memlock_bytes >= 1e6 * LOCKED_MB):
        return ok(GROUP, "priorities", "this user may ask for real-time priority and locked memory")
    detail = f"rtprio {user.rtprio:g}, {PRIORITY} needed; memlock {user.memlock_bytes / 1e6:.0f} MB, {LOCKED_MB} needed"
    fix = (
        "printf '%s - rtprio 99\\n%s - memlock unlimited\\n' $USER $USER | sudo tee "
        "/etc/security/limits.d/realtime.conf, then log in again"
    )
    return missing(GROUP, "priorities", detail, fix)


def governor(governors: Sequence[str]) -> Finding:
    """The frequency governors of all cores; empty if the machine has a fixed clock, or does not report them."""
    if not governors:
        return ok(GROUP, "clock frequency", "this machine has no frequency governor")
    slow = [name for name in governors if name != "performance"]
    if slow:
        detail = f"governor {slow[0]} on {len(slow)} of {len(governors)} cores: cycles come late while it speeds up"
        return advice(GROUP, "clock frequency", detail, "sudo cpupower frequency-set -g performance")
    return ok(GROUP, "clock frequency", "governor performance on every core")


def network(address: str, trips: RoundTrips) -> Finding:
    """Round trips to the arm: time, jitter, losses."""
    if not trips.times_ms:
        fix = (
            "check that the arm is on, the cable in its control box, and this machine's address in the same network: "
            f"ping {address}"
        )
        return missing(DEVICES, "network", f"{address} does not answer: {trips.problem}", fix)
    worst, usual = max(trips.times_ms), median(trips.times_ms)
    told = f"{address} answers in {usual:.2f} ms, {worst:.2f} ms at worst"
    if trips.lost or worst > MOST_RTT_MS:
        fix = "one cable, no switch, no USB adapter; no power saving: sudo ethtool --set-eee DEVICE eee off"
        tries = len(trips.times_ms) + trips.lost
        return advice(
            DEVICES, "network", f"{told}, {trips.lost} of {tries} lost; recommended: {MOST_RTT_MS:g} ms, 0 lost", fix
        )
    return ok(DEVICES, "network", told)


def serial_port(what: str, path: str, port: Port, others: Sequence[str]) -> Finding:
    """Whether a serial port exists and may be used; `others` are the existing ports."""
    if not port.exists:
        fix = f"plug it in, or write its port into the rig file; there now: {', '.join(others) or 'none'}"
        return missing(DEVICES, f"{what} port", f"{path} is not there", fix)
    if not port.may:
        fix = f"sudo usermod -aG {port.group} $USER, then log in again"
        return missing(DEVICES, f"{what} port", f"{path} belongs to the group {port.group}, and you are not in it", fix)
    return ok(DEVICES, f"{what} port", f"{path} may be used")
