"""Checks of the lab: rig file, calibration, checkpoint, world, motion, and the devices that answer."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import TYPE_CHECKING

from adaptsim_cli.doctor.finding import Finding, advice, missing, ok, skipped

if TYPE_CHECKING:
    from calib.saved import SavedCalibration
    from hw.camera.probe import ProbeReport

DEVICES, LEARNING = "devices", "task"


def calibration(known: SavedCalibration | None, days: int, now: datetime, hw: str) -> Finding:
    """`days` is the setting calibration_days."""
    if known is None:
        fix = f"adaptsim calibrate --hw {hw}, ten minutes"
        return missing(DEVICES, "calibration", "this rig has no calibration: the camera pose is unknown", fix)
    u, age = known.uncertainty, (now - datetime.fromisoformat(known.created)).days
    found = f"± {u.sigma_mm:.1f} mm, ± {u.sigma_deg:.2f}°, {age} day{'s' if age != 1 else ''} old"
    if age >= days:
        fix = f"has the camera moved? adaptsim calibrate check --hw {hw}, one minute"
        return advice(DEVICES, "calibration", f"{found} (calibration_days {days})", fix)
    return ok(DEVICES, "calibration", found)


def camera(report: ProbeReport, serial: str) -> Finding:
    """`serial` as the rig file has it; empty: any."""
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


def answers(name: str, ask: Callable[[], str], errors: tuple[type[Exception], ...], fix: str) -> Finding:
    """A device that is asked for a sign of life: `ask` returns what it said, or raises one of `errors`."""
    try:
        return ok(DEVICES, name, ask())
    except errors as error:
        return missing(DEVICES, name, str(error), fix)


def attempt(name: str, load: Callable[[], str], errors: tuple[type[Exception], ...], fix: str) -> Finding:
    """Something of the task that is loaded for a look: `load` returns what is there, or raises one of `errors`."""
    try:
        return ok(LEARNING, name, load())
    except errors as error:
        return missing(LEARNING, name, str(error), fix)


def no_pedal(*, waived: bool) -> Finding:
    """A rig file without a pedal: advice where it waives one, else the arm does not move."""
    fix = "docs/guide/enable-pedal.md: build one, and name its port in [pedal] of the rig file"
    if waived:
        return advice(DEVICES, "pedal", "waived by the rig file: only the arm's own stop button ends a motion", fix)
    fix += ", or say without_pedal = true"
    return missing(DEVICES, "pedal", "the rig file names none, and the arm does not move", fix)


def not_needed(names: tuple[str, ...]) -> tuple[Finding, ...]:
    """What the simulated lab does without."""
    return tuple(skipped(DEVICES, name, "not checked: hw = fake needs none") for name in names)
