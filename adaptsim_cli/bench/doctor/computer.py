"""The checks of the program and of the computer: packages, drivers, plug-ins, disk, kernel, priorities."""

from __future__ import annotations

import importlib.metadata
import platform
import shutil
from collections.abc import Mapping
from functools import partial
from typing import Any

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from adaptsim_cli.bench.doctor import readings
from adaptsim_cli.bench.doctor.table import (
    MACHINE,
    PROGRAM,
    DoctorCheck,
    Examined,
    Finding,
    add_check,
    advice,
    missing,
    ok,
    real,
)
from adaptsim_cli.bench.rig_file import devices
from hw.camera import kinds
from hw.errors import DeviceUnavailable
from hw.franka.realtime import HIGHEST
from hw.franka.versions import MATRIX, PACKAGES
from hw.plugins import Offer, Registry, offers
from hw.serial import balance
from perception import raycasting
from sim import tasks
from sim.adaptation import methods
from sim.errors import SimError

CHECKS: dict[str, DoctorCheck] = {}
"""The checks of the computer by their names, in the order of the screen."""

check = partial(add_check, CHECKS)


def offered() -> tuple[Offer, ...]:
    """The tasks, cameras, balances, instruments and methods that other packages offer."""
    return tuple(offer for group in REGISTRIES for offer in offers(group))


LIBRARIES = {
    "Open3D": (("open3d-cpu", "open3d"), raycasting.LIBRARIES),
    "Drake": (("drake",), {"libglib-2.0.so.0": "libglib2.0-0"}),
}
"""Program -> the packages that hold it, and each library that it loads with that library's Debian package."""


@check(PROGRAM, "python", "make PYTHON=python3.11, in a new checkout")
def _python(lab: Examined) -> Finding:
    version, specifier = platform.python_version(), importlib.metadata.metadata("adaptsim")["Requires-Python"]
    return ok(version) if SpecifierSet(specifier).contains(version) else missing(f"{version}, needed {specifier}")


@check(PROGRAM, "packages", "make setup (or pip install -r requirements.lock)")
def _packages(lab: Examined) -> Finding:
    every = map(Requirement, importlib.metadata.requires("adaptsim") or ())
    needed = [one for one in every if one.marker is None or one.marker.evaluate({"extra": ""})]
    wrong = []
    for one in needed:
        version = readings.installed(one.name)
        if version is None:
            wrong.append(f"{one.name} is not installed, needed {one.specifier or 'any version'}")
        elif not one.specifier.contains(version, prereleases=True):
            wrong.append(f"{one.name} {version}, needed {one.specifier}")
    return missing("; ".join(wrong)) if wrong else ok(f"{len(needed)} with the required versions")


@check(PROGRAM, "libraries")
def _libraries(lab: Examined) -> Finding:
    used = {
        program: libraries for program, (names, libraries) in LIBRARIES.items() if any(map(readings.installed, names))
    }
    if not used:
        return missing(f"neither {' nor '.join(LIBRARIES)} is installed, so nothing was tried", "make setup")
    gone = [package for each in used.values() for name, package in each.items() if not raycasting.loads(name)]
    if gone:
        return missing(f"cannot be loaded: {', '.join(gone)}", f"sudo apt-get install -y {' '.join(gone)}")
    return ok(f"{' and '.join(used)} {'find theirs' if len(used) > 1 else 'finds its'}")


OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless", "opencv-contrib-python")
"""The packages that install the module cv2; each overwrites the files of the others."""


@check(PROGRAM, "OpenCV", "make setup")
def _opencv(lab: Examined) -> Finding:
    builds = [name for name in OPENCV if readings.installed(name) is not None]
    if not builds:
        return missing("no package with the module cv2 is installed")
    if len(builds) == 1:
        return ok(f"{builds[0]} alone")
    listed = f"{', '.join(builds[:-1])} and {builds[-1]}"
    again = f"pip uninstall -y {' '.join(builds)}, then pip install {OPENCV[0]}"
    return advice(f"{listed} write the same module cv2, so its files may be of two versions", again)


REGISTRIES: Mapping[str, Registry[Any]] = {
    registry.group: registry
    for registry in (
        tasks.REGISTRY,
        kinds.CAMERAS,
        balance.BALANCES,
        methods.REGISTRY,
        devices.OFFERED_INSTRUMENTS,
    )
}
"""Everything that packages may offer, by its group of entry points."""


@check(PROGRAM, "plug-ins", "pip uninstall the package, or mend it", lambda lab: "" if offered() else "none installed")
def _plugins(lab: Examined) -> Finding:
    """Everything that other packages offer, each loaded once."""
    problems = [clash for registry in REGISTRIES.values() for clash in registry.clashing()]
    for offer in offered():
        try:
            REGISTRIES[offer.group].get(offer.name)
        except (SimError, DeviceUnavailable) as error:
            problems.append(str(error))
    if problems:
        return advice("; ".join(dict.fromkeys(problems)))
    return ok(
        ", ".join(f"{REGISTRIES[one.group].label} {one.name} of {one.package} {one.version}" for one in offered())
    )


@check(PROGRAM, "driver", when=real)
def _driver(lab: Examined) -> Finding:
    """The vendor's package for an arm, with its row of the compatibility matrix."""
    package = PACKAGES[lab.config.hw]
    row = next(row for row in MATRIX if row.interface == package.interface)
    version = readings.installed(package.name)
    if version is None:
        return missing(f"{package.name} is not installed; it speaks {row}", package.install)
    if version != package.version:
        message = f"{package.name} {version} is installed, but {package.version} was tested, which speaks {row}"
        return missing(message, package.install)
    return ok(f"{package.name} {version} speaks {row}")


LOCKED_MB = 100
"""The lock limit in libfranka's notes, so that a cycle never waits for a memory page."""


@check(MACHINE, "disk space", "remove something there, or set ADAPTSIM_HOME to a larger disk")
def _disk_space(lab: Examined) -> Finding:
    folder, least_mb = readings.existing(lab.resolved.places.data), lab.config.min_free_mb
    free_mb = shutil.disk_usage(folder).free // 1_000_000
    if free_mb < least_mb:
        return missing(f"{free_mb} MB free in {folder}, {least_mb} MB needed (min_free_mb)")
    return ok(f"{free_mb / 1000:.1f} GB free")


SLOW_MB_S, SLOW_FLUSH_S = 20.0, 0.2
"""A trial's recording has about 40 MB, and the operator waits for it."""


@check(MACHINE, "disk speed", "set ADAPTSIM_HOME to a local disk: every trial waits for this one")
def _disk_speed(lab: Examined) -> Finding:
    folder = readings.existing(lab.resolved.places.data)
    try:
        mb_s, flush_s = readings.write_speed(folder)
    except OSError as error:
        problem = error.strerror or str(error)
        return missing(f"{folder} cannot be written to: {problem}", f"sudo chown -R $USER {folder}")
    message = f"{mb_s:.0f} MB/s, a record is safe after {1e3 * flush_s:.0f} ms"
    if mb_s < SLOW_MB_S or flush_s > SLOW_FLUSH_S:
        return advice(f"{message}; recommended: {SLOW_MB_S:g} MB/s, {1e3 * SLOW_FLUSH_S:g} ms")
    return ok(message)


_RT_KERNEL = "sudo apt-get install -y linux-image-rt-amd64, then boot it (Ubuntu: sudo pro enable realtime-kernel)"


@check(MACHINE, "real-time kernel", _RT_KERNEL, real)
def _kernel(lab: Examined) -> Finding:
    release, is_real_time = readings.kernel()
    late = "the arm stops with communication_constraints_violation when cycles are late"
    return ok(release) if is_real_time else missing(f"{release} is not real-time: {late}")


_RT_LIMITS = (
    "printf '%s - rtprio 99\\n%s - memlock unlimited\\n' $USER $USER | sudo tee /etc/security/limits.d/realtime.conf, "
    "then log in again"
)


@check(MACHINE, "priorities", _RT_LIMITS, real)
def _priorities(lab: Examined) -> Finding:
    rtprio, memlock_MB, privileged = readings.limits()
    if privileged or (rtprio >= HIGHEST and memlock_MB >= LOCKED_MB):
        return ok("this user may ask for real-time priority and locked memory")
    return missing(f"rtprio {rtprio:g}, {HIGHEST} needed; memlock {memlock_MB:.0f} MB, {LOCKED_MB} needed")


@check(MACHINE, "clock frequency", "sudo cpupower frequency-set -g performance", real)
def _clock_frequency(lab: Examined) -> Finding:
    governors = readings.governors()
    slow = [name for name in governors if name != "performance"]
    if slow:
        message = f"governor {slow[0]} on {len(slow)} of {len(governors)} cores"
        return advice(f"{message}: cycles come late while it speeds up")
    return ok("governor performance on every core" if governors else "this machine has no frequency governor")
