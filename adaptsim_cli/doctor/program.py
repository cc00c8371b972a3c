"""Checks of the program itself: Python, packages, system libraries, the driver of the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from adaptsim_cli.doctor.finding import Finding, missing, ok
from hw.franka.versions import MATRIX, PACKAGES

GROUP = "program"
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
        return ok(GROUP, "python", version)
    return missing(GROUP, "python", f"{version}, needed {wanted}", "make PYTHON=python3.11, in a new checkout")


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
        return missing(GROUP, "packages", "; ".join(wrong), "make setup (or pip install -r requirements.lock)")
    return ok(GROUP, "packages", f"{len(needed)} with the required versions")


def libraries(loads: Callable[[str], bool]) -> Finding:
    """System libraries of Open3D and Drake."""
    gone = [package for name, package in LIBRARIES.items() if not loads(name)]
    if gone:
        line = f"sudo apt-get install -y {' '.join(gone)}"
        return missing(GROUP, "libraries", f"cannot be loaded: {', '.join(gone)}", line)
    return ok(GROUP, "libraries", "Open3D and Drake find theirs")


def driver(model: str, installed: Callable[[str], str | None]) -> Finding:
    """The vendor's package for an arm, with its row of the compatibility matrix."""
    wanted = PACKAGES[model]
    row = next(row for row in MATRIX if row.interface == wanted.interface)
    version = installed(wanted.name)
    if version is None:
        return missing(GROUP, "driver", f"{wanted.name} is not installed; it speaks {row}", wanted.install)
    if version != wanted.version:
        detail = f"{wanted.name} {version} is installed, tested is {wanted.version}, which speaks {row}"
        return missing(GROUP, "driver", detail, wanted.install)
    return ok(GROUP, "driver", f"{wanted.name} {version} speaks {row}")
