"""Every kind of camera by name: ours, and those of installed packages.

A kind is one declaration. The rig file takes its name in `[camera] kind`, `setup` offers it, the doctor looks for its
devices, and its driver runs in a process of its own. A package offers one by an entry point of the group
`adaptsim.cameras`: the kind's name, and a module with a `CAMERA` (docs/guide/add-a-device.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hw.camera.probe import FoundDevice, ProbeReport, probe_k4a, probe_offered, probe_realsense
from hw.errors import DeviceUnavailable
from hw.plugins import Registry


@dataclass(frozen=True)
class CameraKind:
    """One kind of camera."""

    label: str  # the makers' names of the cameras
    make: str  # its `hw.camera.served.Make`, as module:name
    find: Callable[[], Sequence[FoundDevice]] = tuple
    """The cameras of this kind that are plugged in. It runs in a child process, which a library may crash."""
    install: str = ""  # how to install what it needs, for a message
    probe: Callable[[float], ProbeReport] | None = None
    """The same within so many seconds, with a report about its library. If it is None, `find` is called in a child
    process."""


KINDS = {
    "k4a": CameraKind("Azure Kinect, Femto Bolt", "hw.camera.served:kinect", probe=lambda s: probe_k4a(patience_s=s)),
    "realsense": CameraKind(
        "Intel D400 family", "hw.camera.realsense:RealSenseDevice", probe=lambda s: probe_realsense(patience_s=s)
    ),
}


CAMERAS = Registry[CameraKind](
    label="camera",
    group="adaptsim.cameras",
    attribute="CAMERA",
    ours=KINDS,
    error=DeviceUnavailable,
    value_type=CameraKind,
)


def probe(name: str, patience_s: float) -> ProbeReport:
    """The cameras of a kind that are plugged in, as a child process sees them. Raises DeviceUnavailable."""
    kind = CAMERAS.get(name)
    if kind.probe is not None:
        return kind.probe(patience_s)
    return probe_offered(name, kind.install, patience_s)
