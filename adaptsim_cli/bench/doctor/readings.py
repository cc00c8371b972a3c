"""Readings of this machine for the checks, without judgement."""

from __future__ import annotations

import grp
import importlib.metadata
import os
import resource
import socket
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hw.camera.probe import ProbeReport
    from hw.franka.identity import ArmReport
    from hw.franka.process import Inspection
    from hw.franka.settings import FrankaSettings
    from hw.franka.starting import Rehearsal

_BLOCK, _BLOCKS = bytes(1 << 20), 16
_SMALL = bytes(4096)
_TRIES, _PATIENCE_S, _DESK_PORT = 20, 0.5, 443
LOOK_S = 5.0
"""How long libk4a may take to list its cameras."""


def installed(package: str) -> str | None:
    """The version of an installed package; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def write_speed(folder: Path) -> tuple[float, float]:
    """Time 16 MB and a small file until both are on the disk -> MB/s, s. Leaves nothing behind. Raises OSError."""
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".adaptsim-doctor-") as file:
        began = time.perf_counter()
        for _ in range(_BLOCKS):
            file.write(_BLOCK)
        file.flush()
        os.fsync(file.fileno())
        written = time.perf_counter()
        file.write(_SMALL)
        file.flush()
        os.fsync(file.fileno())
        return _BLOCKS * 1.048576 / (written - began), time.perf_counter() - written


def existing(folder: Path) -> Path:
    """`folder`, or its nearest existing parent."""
    return folder if folder.is_dir() or folder == folder.parent else existing(folder.parent)


def round_trips(
    address: str, port: int = _DESK_PORT, tries: int = _TRIES, patience_s: float = _PATIENCE_S
) -> tuple[Sequence[float], int, str]:
    """Connect to the arm's web page repeatedly -> times in ms, number of tries without an answer, last reason.

    The arm's system answers; none of its programs is disturbed. A refused connection counts as an answer. Gives up
    after two tries without an answer.
    """
    times_ms: list[float] = []
    lost, problem = 0, ""
    try:
        where = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        return (), tries, f"no such address ({error.strerror})"
    for _ in range(tries):
        with socket.socket(where[0], socket.SOCK_STREAM) as line:
            line.settimeout(patience_s)
            began = time.perf_counter()
            try:
                line.connect(where[4])
            except ConnectionRefusedError:
                pass
            except OSError as error:
                lost, problem = lost + 1, error.strerror or "no answer"
                if lost == 2 and not times_ms:
                    break
                continue
            times_ms.append(1e3 * (time.perf_counter() - began))
    return times_ms, lost, problem


def limits() -> tuple[float, float, bool]:
    """The soft limits of this process: real-time priority, locked memory in MB, and whether root may exceed them."""

    def soft(kind: int) -> float:
        value = resource.getrlimit(kind)[0]
        return float("inf") if value == resource.RLIM_INFINITY else float(value)

    return soft(resource.RLIMIT_RTPRIO), soft(resource.RLIMIT_MEMLOCK) / 1e6, os.geteuid() == 0


def governors(cpus: Path = Path("/sys/devices/system/cpu")) -> tuple[str, ...]:
    """The frequency governors of all cores that have one."""
    return tuple(file.read_text().strip() for file in sorted(cpus.glob("cpu[0-9]*/cpufreq/scaling_governor")))


def port(path: Path) -> tuple[bool, str | None]:
    """Whether this user may use the serial port at `path`, and its group; None: it does not exist. Opens nothing."""
    if not path.exists():
        return False, None
    owner = path.stat().st_gid
    try:
        group = grp.getgrgid(owner).gr_name
    except KeyError:
        group = str(owner)
    return os.access(path, os.R_OK | os.W_OK), group


def kernel() -> tuple[str, bool]:
    """The release of the kernel, and whether it is real-time."""
    from hw.franka.realtime import kernel_is_real_time

    return os.uname().release, kernel_is_real_time()


def arm(model: str, settings: FrankaSettings) -> Inspection:
    """The arm over FCI, without a motion. Raises DeviceUnavailable."""
    from hw.franka.process import inspect

    return inspect(model, settings, realtime=kernel()[1])


def arm_report(model: str, settings: FrankaSettings) -> ArmReport:
    """The arm's description of itself. Raises DeviceUnavailable."""
    from hw.franka.process import ask_report

    return ask_report(model, settings, realtime=kernel()[1])


def rehearsal(model: str, settings: FrankaSettings) -> Rehearsal:
    """Ten starts without a motion and a minute at rest. Raises DeviceUnavailable."""
    from hw.franka.process import rehearse

    return rehearse(model, settings, realtime=kernel()[1])


def cameras(kind: str) -> ProbeReport:
    """The cameras of this kind that are plugged in. Raises DeviceUnavailable."""
    from hw.camera.kinds import probe

    return probe(kind, LOOK_S)


def serial_ports(dev: Path) -> tuple[str, ...]:
    """Serial ports of USB devices in `dev`: by their lasting name, else by the system's number."""
    named = sorted((dev / "serial/by-id").glob("*"))
    numbered = [port for kind in ("ttyACM*", "ttyUSB*") for port in sorted(dev.glob(kind))]
    targets = {link.resolve() for link in named}
    return tuple(map(str, [*named, *(port for port in numbered if port.resolve() not in targets)]))


def like(ports: Sequence[str], words: Sequence[str]) -> str:
    """The first port with one of the `words` in its name; empty if there is none."""
    return next((port for port in ports if any(word in port.lower() for word in words)), "")
