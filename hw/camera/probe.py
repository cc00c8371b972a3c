"""Looks for cameras and their library in a child process, so that a library that crashes ends only the child."""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from hw.camera import k4a_library, realsense
from hw.camera.k4a_library import INSTALL, SUCCEEDED, HardwareVersion, K4aLibrary
from hw.child import python_module
from hw.errors import DeviceUnavailable

REALSENSE = "pyrealsense2"
_OFFERED = "camera of a package: "
_MARK = "K4A-PROBE "  # libk4a may write to stdout too
_PATIENCE_S = 20.0
_CHILD = python_module("hw.camera.probe")
_PLUG = (
    "plug the camera into a USB 3 port of its own with its own power supply, wait until its light is on, and install "
    "the udev rules of docs/guide/cameras.md if you are not root"
)


@dataclass(frozen=True)
class FoundDevice:
    """One camera that is plugged in."""

    index: int
    serial: str  # "" where it could not be opened
    firmware: str  # "colour 1.6.110, depth 1.6.80"; "" if not reported
    error: str | None = None  # why it cannot be used now, and the remedy


@dataclass(frozen=True)
class ProbeReport:
    """The child's findings about the library and its cameras."""

    library: str | None  # the file loaded; None: none found
    version: str | None  # of the library, from the name of its file
    maker: str | None  # "Microsoft", "Orbbec" or "Intel"
    depth_engine: bool  # whether the closed library that turns raw readings into depth is found
    devices: tuple[FoundDevice, ...]
    error: str | None  # None if at least one camera can be used
    fix: str | None  # the remedy

    @property
    def serials(self) -> tuple[str, ...]:
        """Serial numbers of the cameras that can be used."""
        return tuple(device.serial for device in self.devices if device.error is None)

    def require(self) -> None:
        """Raises DeviceUnavailable with the problem and its remedy."""
        if self.error is not None:
            raise DeviceUnavailable(f"{self.error}. {self.fix}")

    def as_json(self) -> dict[str, Any]:
        """The fields of the report, for JSON."""
        return asdict(self)


def probe_k4a(file: str | None = None, patience_s: float = _PATIENCE_S, child: Sequence[str] = _CHILD) -> ProbeReport:
    """Load libk4a (`file`, else what `k4a_library.library_file` finds) in a child, and open every camera for a moment.

    A defect of library or camera never raises and never ends this process; the report states it. A camera in use by
    another program is listed with its error. `child` is the command that gets the file as its argument.
    """
    chosen = file or k4a_library.library_file()
    if chosen is None:
        return _nothing(None, "libk4a, the camera's library, is not installed", _sentence(INSTALL))
    return _asked(child, chosen, patience_s, INSTALL)


def probe_realsense(patience_s: float = _PATIENCE_S, child: Sequence[str] = _CHILD) -> ProbeReport:
    """The same for the cameras that `pyrealsense2` sees."""
    return _asked(child, REALSENSE, patience_s, realsense.INSTALL)


def probe_offered(
    name: str, install: str, patience_s: float = _PATIENCE_S, child: Sequence[str] = _CHILD
) -> ProbeReport:
    """The same for the cameras of a kind that a package offers."""
    return _asked(child, f"{_OFFERED}{name}", patience_s, install or "see the page of its package")


def _asked(child: Sequence[str], chosen: str, patience_s: float, install: str) -> ProbeReport:
    """The report of a child process that looks with the library `chosen`."""
    try:
        ended = subprocess.run(
            [*child, chosen],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=patience_s,
            check=False,
            cwd=Path(__file__).parents[2],
        )
    except subprocess.TimeoutExpired:
        why = f"{chosen} did not answer within {patience_s:g} s"
        return _nothing(chosen, why, "Unplug the camera, wait ten seconds, plug it in again")
    answer = next((line for line in reversed(ended.stdout.splitlines()) if line.startswith(_MARK)), None)
    if answer is None:
        why = f"{chosen} ended its process ({_how(ended.returncode)}) while it listed the cameras"
        return _nothing(chosen, why, f"The installation is damaged or does not fit this machine: {install}")
    return _report(json.loads(answer.removeprefix(_MARK)))


def look(library: K4aLibrary, file: str, maps: str) -> ProbeReport:
    """Query `library`, loaded from `file`; `maps` is the content of /proc/self/maps after loading."""
    maker = "Orbbec" if "OrbbecSDK" in maps else "Microsoft"
    devices = tuple(_device(library, index) for index in range(library.k4a_device_get_installed_count()))
    usable = any(device.error is None for device in devices)
    error, fix = f"{file} finds no camera", _sentence(_PLUG)
    if devices:
        error, fix = devices[0].error or "", "Close the other program, or see docs/guide/cameras.md on permissions"
    return ProbeReport(
        library=file,
        version=_version(file),
        maker=maker,
        depth_engine=_depth_engine(file),
        devices=devices,
        error=None if usable else error,
        fix=None if usable else fix,
    )


def look_realsense(devices: Sequence[Any]) -> ProbeReport:
    """The devices of `pyrealsense2`, each with its firmware; one at a USB 2 port cannot be used."""
    sdk = import_module(REALSENSE)
    info = sdk.camera_info
    listing = []
    for index, device in enumerate(devices):
        details = {key: device.get_info(key) for key in (info.serial_number, info.firmware_version)}
        usb = device.get_info(info.usb_type_descriptor) if device.supports(info.usb_type_descriptor) else ""
        why = f"it is at a USB {usb} port, which is too slow for colour and depth" if usb.startswith("2") else None
        listing.append(FoundDevice(index, details[info.serial_number], details[info.firmware_version], why))
    usable = any(device.error is None for device in listing)
    error = None if usable else listing[0].error if listing else f"{REALSENSE} finds no camera"
    fix = None if usable else "plug the camera into a USB 3 port of its own, with the cable that came with it"
    return ProbeReport(REALSENSE, sdk.__version__, "Intel", True, tuple(listing), error, fix)


def _device(library: K4aLibrary, index: int) -> FoundDevice:
    handle = ctypes.c_void_p()
    if library.k4a_device_open(index, ctypes.byref(handle)) != SUCCEEDED:
        why = f"camera {index} is plugged in but cannot be opened: another program uses it, or permission is missing"
        return FoundDevice(index, "", "", why)
    try:
        version = HardwareVersion()
        answered = library.k4a_device_get_version(handle, ctypes.byref(version)) == SUCCEEDED
        firmware = f"colour {version.rgb}, depth {version.depth}" if answered else ""
        return FoundDevice(index, k4a_library.serial_of(library, handle), firmware)
    finally:
        library.k4a_device_close(handle)


def _version(file: str) -> str | None:
    """The version from the file's name (libk4a.so.1.4.1, libk4a-….so.1.4.2): the library has no function for it."""
    _, suffix, version = Path(file).resolve().name.partition(".so.")
    return version if suffix else None


def _depth_engine(file: str) -> bool:
    name = "libdepthengine.so.2.0"
    if (Path(file).resolve().parent / name).exists():
        return True
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def _report(content: Mapping[str, Any]) -> ProbeReport:
    devices = tuple(FoundDevice(**device) for device in content["devices"])
    return ProbeReport(**{**content, "devices": devices})


def _nothing(file: str | None, error: str, fix: str) -> ProbeReport:
    return ProbeReport(file, _version(file) if file else None, None, False, (), error, fix)


def _how(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _look_offered(name: str) -> ProbeReport:
    """The cameras of a kind that a package offers, by its own `find`."""
    from hw.camera.kinds import CAMERAS  # noqa: PLC0415 - kinds are declared with these probes

    try:
        kind = CAMERAS.get(name)
        devices = tuple(kind.find())
    except Exception as error:  # noqa: BLE001 - whatever a foreign library raises is the finding
        return _nothing(name, f"{type(error).__name__}: {error}", "mend the package of this camera")
    usable = any(device.error is None for device in devices)
    problem = None if usable else (devices[0].error if devices else f"no {kind.label} is plugged in")
    return ProbeReport(
        name, None, kind.label, True, devices, problem, None if usable else _sentence(kind.install or _PLUG)
    )


def _child(file: str) -> ProbeReport:
    if file.startswith(_OFFERED):
        return _look_offered(file.removeprefix(_OFFERED))
    if file == REALSENSE:
        try:
            return look_realsense(realsense.plugged_in())
        except DeviceUnavailable as error:
            return _nothing(REALSENSE, str(error), realsense.INSTALL)
    try:
        library = k4a_library.load(file)
    except DeviceUnavailable as error:
        return _nothing(file, str(error), _sentence(INSTALL))
    maps = Path("/proc/self/maps")
    return look(library, file, maps.read_text() if maps.exists() else "")


if __name__ == "__main__":
    sys.stdout.write("\n" + _MARK + json.dumps(_child(sys.argv[1]).as_json()) + "\n")
