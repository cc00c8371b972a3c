"""The checks of the checklist: each judges one reading and names the remedy. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from statistics import median
from typing import TYPE_CHECKING, Any

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from adaptsim_cli.devices.known_arm import ArmFacts
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.required import gaps
from adaptsim_cli.doctor.readings import Limits, Port, RoundTrips, WriteSpeed
from hw.franka.realtime import PRIORITY
from hw.franka.versions import MATRIX, PACKAGES

if TYPE_CHECKING:
    from calib.saved import SavedCalibration
    from hw.camera.probe import ProbeReport
    from hw.franka.inspection import Inspection


class Severity(Enum):
    """The severity of a finding; only MISSING prevents an iteration."""

    OK = "ok"
    ADVICE = "advice"  # works, not recommended
    MISSING = "missing"  # an iteration cannot run
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """One line of the checklist. `fix` is the remedy, a command if there is one."""

    group: str
    name: str
    verdict: Severity
    detail: str
    fix: str = ""


def ok(group: str, name: str, detail: str) -> Finding:
    """Ready; no remedy needed."""
    return Finding(group, name, Severity.OK, detail)


def advice(group: str, name: str, detail: str, fix: str) -> Finding:
    """It works, not recommended; `fix` is recommended."""
    return Finding(group, name, Severity.ADVICE, detail, fix)


def missing(group: str, name: str, detail: str, fix: str) -> Finding:
    """An iteration cannot run until `fix` is done."""
    return Finding(group, name, Severity.MISSING, detail, fix)


def skipped(group: str, name: str, why: str) -> Finding:
    """Not checked, for the reason `why`."""
    return Finding(group, name, Severity.SKIPPED, why)


PROGRAM = "program"
LIBRARIES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libglib-2.0.so.0": "libglib2.0-0",
}
"""Library that Open3D or Drake loads -> its Debian package."""


def python(version: str, wanted: str) -> Finding:
    """`version` of the interpreter against `wanted`, the package's Requires-Python."""
    if SpecifierSet(wanted).contains(version):
        return ok(PROGRAM, "python", version)
    return missing(PROGRAM, "python", f"{version}, needed {wanted}", "make PYTHON=python3.11, in a new checkout")


def packages(requirements: Sequence[str], installed: Callable[[str], str | None]) -> Finding:
    """The required packages; `installed` returns a version, or None if a package is missing."""
    needed = [r for text in requirements if (r := Requirement(text)).marker is None or r.marker.evaluate({"extra": ""})]
    wrong = []
    for requirement in needed:
        version = installed(requirement.name)
        if version is None:
            wrong.append(f"{requirement.name} is not installed, needed {requirement.specifier or 'any version'}")
        elif not requirement.specifier.contains(version, prereleases=True):
            wrong.append(f"{requirement.name} {version}, needed {requirement.specifier}")
    if wrong:
        return missing(PROGRAM, "packages", "; ".join(wrong), "make setup (or pip install -r requirements.lock)")
    return ok(PROGRAM, "packages", f"{len(needed)} with the required versions")


def libraries(loads: Callable[[str], bool]) -> Finding:
    """System libraries of Open3D and Drake."""
    gone = [package for name, package in LIBRARIES.items() if not loads(name)]
    if gone:
        line = f"sudo apt-get install -y {' '.join(gone)}"
        return missing(PROGRAM, "libraries", f"cannot be loaded: {', '.join(gone)}", line)
    return ok(PROGRAM, "libraries", "Open3D and Drake find theirs")


def driver(model: str, installed: Callable[[str], str | None]) -> Finding:
    """The vendor's package for an arm, with its row of the compatibility matrix."""
    wanted = PACKAGES[model]
    row = next(row for row in MATRIX if row.interface == wanted.interface)
    version = installed(wanted.name)
    if version is None:
        return missing(PROGRAM, "driver", f"{wanted.name} is not installed; it speaks {row}", wanted.install)
    if version != wanted.version:
        detail = f"{wanted.name} {version} is installed, tested is {wanted.version}, which speaks {row}"
        return missing(PROGRAM, "driver", detail, wanted.install)
    return ok(PROGRAM, "driver", f"{wanted.name} {version} speaks {row}")


MACHINE = "machine"
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
        return missing(MACHINE, "disk space", f"{free_mb} MB free in {folder}, {least_mb} MB needed (min_free_mb)", fix)
    return ok(MACHINE, "disk space", f"{free_mb / 1000:.1f} GB free")


def disk_speed(folder: str, speed: WriteSpeed) -> Finding:
    """How fast `folder` stores data on the disk, and how long a small file takes."""
    if speed.mb_s is None:
        told = f"{folder} cannot be written to: {speed.problem}"
        return missing(MACHINE, "disk speed", told, f"sudo chown -R $USER {folder}")
    found = f"{speed.mb_s:.0f} MB/s, a record is safe after {1e3 * speed.flush_s:.0f} ms"
    if speed.mb_s < SLOW_MB_S or speed.flush_s > SLOW_FLUSH_S:
        fix = "set ADAPTSIM_HOME to a local disk: every trial waits for this one"
        return advice(
            MACHINE, "disk speed", f"{found}; recommended: {SLOW_MB_S:g} MB/s, {1e3 * SLOW_FLUSH_S:g} ms", fix
        )
    return ok(MACHINE, "disk speed", found)


def realtime_kernel(release: str, is_real_time: bool) -> Finding:
    """Whether the kernel is real-time; `release` is that of uname."""
    if is_real_time:
        return ok(MACHINE, "real-time kernel", release)
    detail = f"{release} is not real-time: the arm stops with communication_constraints_violation when cycles are late"
    fix = "sudo apt-get install -y linux-image-rt-amd64, then boot it (Ubuntu: sudo pro enable realtime-kernel)"
    return missing(MACHINE, "real-time kernel", detail, fix)


def priorities(user: Limits) -> Finding:
    """Whether this user may use real-time priority and locked memory."""
    if user.privileged or (user.rtprio >= PRIORITY and user.memlock_bytes >= 1e6 * LOCKED_MB):
        return ok(MACHINE, "priorities", "this user may ask for real-time priority and locked memory")
    detail = f"rtprio {user.rtprio:g}, {PRIORITY} needed; memlock {user.memlock_bytes / 1e6:.0f} MB, {LOCKED_MB} needed"
    fix = (
        "printf '%s - rtprio 99\\n%s - memlock unlimited\\n' $USER $USER | sudo tee "
        "/etc/security/limits.d/realtime.conf, then log in again"
    )
    return missing(MACHINE, "priorities", detail, fix)


def governor(governors: Sequence[str]) -> Finding:
    """The frequency governors of all cores; empty if the machine has a fixed clock, or does not report them."""
    if not governors:
        return ok(MACHINE, "clock frequency", "this machine has no frequency governor")
    slow = [name for name in governors if name != "performance"]
    if slow:
        detail = f"governor {slow[0]} on {len(slow)} of {len(governors)} cores: cycles come late while it speeds up"
        return advice(MACHINE, "clock frequency", detail, "sudo cpupower frequency-set -g performance")
    return ok(MACHINE, "clock frequency", "governor performance on every core")


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


DEVICES, LEARNING = "devices", "task"
MOST_MISSED, LONGEST_GAP_S = 0.05, 0.02
"""Limits for an arm's states: libfranka needs 95 % of the commands in time, and twenty lost in a row stop the arm."""
LEAST_FRAMES = 10


def calibration(known: SavedCalibration | None, days: int, now: datetime, hw: str) -> Finding:
    """Presence and age of the calibration; `days` is the setting calibration_days."""
    if known is None:
        fix = f"adaptsim calibrate --hw {hw}, ten minutes"
        return missing(DEVICES, "calibration", "this rig has no calibration: the camera pose is unknown", fix)
    u, age = known.uncertainty, (now - datetime.fromisoformat(known.created)).days
    found = f"± {u.sigma_mm:.1f} mm, ± {u.sigma_deg:.2f}°, {age} day{'s' if age != 1 else ''} old"
    if age < 0:
        found = f"± {u.sigma_mm:.1f} mm, ± {u.sigma_deg:.2f}°, made {-age} day{'s' if age != -1 else ''} in the future"
        return advice(DEVICES, "calibration", found, "timedatectl set-ntp true: the clock of this computer is wrong")
    if age >= days:
        fix = f"has the camera moved? adaptsim calibrate check --hw {hw}, one minute"
        return advice(DEVICES, "calibration", f"{found} (calibration_days {days})", fix)
    return ok(DEVICES, "calibration", found)


def camera(report: ProbeReport, serial: str) -> Finding:
    """The camera with the rig file's `serial`; empty: any."""
    if report.error is not None:
        return missing(DEVICES, "camera", report.error, report.fix or "see docs/guide/cameras.md")
    if serial and serial not in report.serials:
        fix = f'plug it in, or write into [camera] of the rig file: serial = "{report.serials[0]}"'
        return missing(DEVICES, "camera", f"{serial} is not plugged in; found: {', '.join(report.serials)}", fix)
    if not serial and len(report.serials) > 1:
        fix = "write the serial number of the one to use into [camera] of the rig file"
        return missing(DEVICES, "camera", f"several cameras are plugged in: {', '.join(report.serials)}", fix)
    if not report.depth_engine:
        fix = "install libdepthengine.so.2.0 beside the library; docs/guide/cameras.md"
        return missing(DEVICES, "camera", f"{report.library} has no depth engine, so there would be no depth", fix)
    which = serial or report.serials[0]
    return ok(DEVICES, "camera", f"{which}, {report.maker} library {report.version or '(version unknown)'}")


def arm(seen: Inspection, model: str) -> Finding:
    """The arm's state over FCI, and whether a second of states came without a gap."""
    rhythm, reading = seen.rhythm, seen.reading
    served = "" if rhythm.interface is None else f", interface {rhythm.interface}"
    joints = " ".join(f"{q:.2f}" for q in reading.q_rad)
    told = (
        f"{model} answers over FCI{served}, mode {reading.mode}, joints {joints} rad, external torques of "
        f"up to {max(map(abs, reading.external_Nm)):.1f} Nm at rest; {rhythm.states} states at 1 kHz, "
        f"{rhythm.missed} missed, longest gap {1e3 * rhythm.longest_gap_s:.1f} ms"
    )
    if reading.unwilling is not None:
        fix = "follow the message; every command that moves the arm also leads you through it"
        return missing(DEVICES, "arm", f"{told}; it would not move: {reading.unwilling}", fix)
    if rhythm.missed > MOST_MISSED * rhythm.states or rhythm.longest_gap_s > LONGEST_GAP_S:
        fix = "use one cable without a switch, a real-time kernel, governor performance, and end other programs"
        return advice(DEVICES, "arm", f"{told} (at most {100 * MOST_MISSED:g} % and {1e3 * LONGEST_GAP_S:g} ms)", fix)
    if seen.notes:
        return advice(DEVICES, "arm", told, "; ".join(seen.notes))
    return ok(DEVICES, "arm", told)


def stream(facts: Mapping[str, Any], seconds: float) -> Finding:
    """The stream of synchronised frames, by the camera's own record (`CameraProcess.facts`)."""
    film = facts.get("recording") or {}
    frames, dropped = int(film.get("frames", 0)), int(film.get("dropped", 0))
    told = f"{frames} synchronised frames in {seconds:.1f} s, {dropped} dropped"
    if frames < LEAST_FRAMES:
        fix = "give it a USB 3 controller and a power supply of its own, end other programs; docs/guide/cameras.md"
        return missing(DEVICES, "camera images", f"{told}; at least {LEAST_FRAMES} are needed", fix)
    if dropped:
        return advice(DEVICES, "camera images", told, "give it a USB 3 controller of its own, and end other programs")
    return ok(DEVICES, "camera images", told)


def answers(name: str, ask: Callable[[], str], errors: tuple[type[Exception], ...], fix: str) -> Finding:
    """Whether a device answers: `ask` returns its answer, or raises one of `errors`."""
    try:
        return ok(DEVICES, name, ask())
    except errors as error:
        return missing(DEVICES, name, str(error), fix)


def attempt(name: str, load: Callable[[], str], errors: tuple[type[Exception], ...], fix: str) -> Finding:
    """Whether a part of the task loads: `load` returns its description, or raises one of `errors`."""
    try:
        return ok(LEARNING, name, load())
    except errors as error:
        return missing(LEARNING, name, str(error), fix)


def required(rig: RigDescription, tool: str) -> tuple[Finding, ...]:
    """What the rig file must state or waive: a finding for each gap, and one for all that is waived."""
    found = [
        missing(
            DEVICES, gap.what, f"{gap.message}, and the arm does not move", f'{gap.remedy}, or waived = ["{gap.what}"]'
        )
        for gap in gaps(rig, tool)
    ]
    if rig.waived:
        told = f"{', '.join(rig.waived)}: waived by the rig file, which every trial records"
        found.append(advice(DEVICES, "waived", told, "state them in the rig file: docs/guide/rig.md"))
    return tuple(found)


def stop_button(known: ArmFacts, waived: bool, now: datetime) -> Finding:
    """When the arm's stop button was last found to stop it."""
    if waived:
        return advice(DEVICES, "stop button", "its check is waived by the rig file", "check it by hand every day")
    if not known.stop_button:
        fix = "the next command that moves the arm leads you through the check"
        return advice(DEVICES, "stop button", "it was never checked with this computer", fix)
    told = f"stopped the arm on {known.stop_button} ({known.stop_button_by})"
    if known.stop_button_is_due(now):
        return advice(DEVICES, "stop button", f"{told}: more than a day ago", "the next command checks it again")
    return ok(DEVICES, "stop button", told)


def not_needed(names: tuple[str, ...]) -> tuple[Finding, ...]:
    """The devices that the simulated lab does not need."""
    return tuple(skipped(DEVICES, name, "not checked: hw = fake needs none") for name in names)
