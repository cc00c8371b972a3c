"""The driver for each version of the arm's software, and the packages that it needs.

libfranka refuses an arm with another interface version than its own. The matrix is the maker's
(libfranka documentation, "Robot System Version Compatibility"); the builds of panda-python are those of its README.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import re
from dataclasses import dataclass
from typing import Any

from hw.errors import DeviceUnavailable

PANDA_BUILDS = "https://github.com/JeanElsner/panda-py#libfranka-version"


@dataclass(frozen=True)
class Package:
    """The driver of one model, as it is on the package index."""

    name: str
    version: str
    module: str
    libfranka: str
    interface: int  # version of the arm's research interface

    @property
    def install(self) -> str:
        """The command that installs it."""
        return f"pip install {self.name}=={self.version}"


_MAKERS = Package("pylibfranka", "0.21.3", "pylibfranka", "0.21.3", 10)

PACKAGES = {
    "panda": Package("panda-python", "1.1.1", "panda_py.libfranka", "0.9.2", 5),
    "fr3": _MAKERS,
    "fr3v2": _MAKERS,
}


@dataclass(frozen=True)
class CompatibilityRow:
    """One row of the compatibility matrix."""

    interface: int
    system: str
    libfranka: str
    remedy: str

    def __str__(self) -> str:
        return f"interface {self.interface}: arm system {self.system}, libfranka {self.libfranka}"


_OLD_PANDA = "update the arm to system 4.2.1 or newer, or install panda-python built with that libfranka from "
_OLD_FR3 = "update the arm to system 5.9.0 or newer"

MATRIX = (
    CompatibilityRow(3, "3.0.0 up to 4.0.0 (Panda)", "0.7.1", f"{_OLD_PANDA}{PANDA_BUILDS}"),
    CompatibilityRow(4, "4.0.0 up to 4.2.1 (Panda)", "0.8.0", f"{_OLD_PANDA}{PANDA_BUILDS}"),
    CompatibilityRow(5, "4.2.1 and newer (Panda)", "0.9.1 up to 0.10.0", PACKAGES["panda"].install),
    CompatibilityRow(6, "5.2.0 up to 5.5.0 (FR3)", "0.10.0 up to 0.13.3", _OLD_FR3),
    CompatibilityRow(7, "5.5.0 up to 5.7.0 (FR3)", "0.13.3 up to 0.14.1", _OLD_FR3),
    CompatibilityRow(8, "5.7.0 up to 5.7.2 (FR3)", "0.14.1 up to 0.15.0", _OLD_FR3),
    CompatibilityRow(9, "5.7.2 up to 5.9.0 (FR3)", "0.15.0 up to 0.18.0", _OLD_FR3),
    CompatibilityRow(10, "5.9.0 and newer (FR3, FR3 v2)", "0.18.0 and newer", PACKAGES["fr3"].install),
)

_MISMATCH = re.compile(r"Incompatible library version \(server version: (\d+), library version: (\d+)")


def installed(package: Package) -> str:
    """The installed version of a driver. Raises DeviceUnavailable with the line that installs the tested one."""
    try:
        version = importlib.metadata.version(package.name)
    except importlib.metadata.PackageNotFoundError:
        raise DeviceUnavailable(f"the driver {package.name} is not installed; run: {package.install}") from None
    if version != package.version:
        raise DeviceUnavailable(
            f"the driver {package.name} {version} is installed, but {package.version} "
            f"(libfranka {package.libfranka}) was tested; run: {package.install}"
        )
    return version


def load(package: Package) -> Any:
    """The driver's module, after `installed`. Raises DeviceUnavailable."""
    installed(package)
    try:
        return importlib.import_module(package.module)
    except ImportError as error:
        raise DeviceUnavailable(
            f"the driver {package.name} {package.version} is installed and does not import ({error}); it needs "
            f"glibc 2.34 or newer (Debian 12, Ubuntu 22.04); run: {package.install} --force-reinstall"
        ) from error


def explain_mismatch(model: str, text: str) -> str | None:
    """libfranka's message about another interface version -> row of the matrix, and remedy; None for other messages."""
    match = _MISMATCH.search(text)
    if match is None:
        return None
    server, package = int(match[1]), PACKAGES[model]
    row = next((row for row in MATRIX if row.interface == server), None)
    spoken = f"the arm speaks interface version {server}, {package.name} {package.version} speaks {match[2]}"
    if row is None:
        return f"{spoken}; the compatibility matrix has no row for it: update adaptsim, or ask which system the arm has"
    others = " or ".join(name for name, one in PACKAGES.items() if one.interface == server and one != package)
    if others:
        return f"{spoken} ({row}); this arm is of the model {others}: say so in the rig file, and run: {row.remedy}"
    return f"{spoken} ({row}); {row.remedy}"
