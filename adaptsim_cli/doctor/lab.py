"""Checks of the lab: rig file, calibration, checkpoint, world, motion, and the devices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any

from adaptsim_cli.devices.known_arm import Known
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.required import gaps
from adaptsim_cli.doctor.finding import Finding, advice, missing, ok, skipped

if TYPE_CHECKING:
    from calib.saved import SavedCalibration
    from hw.camera.probe import ProbeReport
    from hw.franka.inspection import Inspection

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


def stop_button(known: Known, waived: bool, now: datetime) -> Finding:
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
