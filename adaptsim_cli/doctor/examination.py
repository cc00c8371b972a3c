"""The whole checklist, in the order of the screen."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from adaptsim_cli.config import Config, Places, Resolved, same_lab
from adaptsim_cli.devices.known_arm import KnownArm, folder_of
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.inventory import serial_ports
from adaptsim_cli.devices.rig_file.reading import rig_of, tasks_with_tools
from adaptsim_cli.doctor import checks, readings
from adaptsim_cli.doctor.checks import Finding, Severity, missing, ok, skipped
from adaptsim_cli.errors import PreflightFailed, SessionError, UsageError
from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.wiring import calibration as wiring_calibration
from calib.errors import CalibrationError
from hw.camera.process import CameraProcess
from hw.errors import BalanceError, CameraError, DeviceUnavailable, MotionRefused
from sim.errors import SimError

STREAM_S = 0.5
LOOK_S = 5.0
"""How long libk4a may take to list its cameras."""


def examine(resolved: Resolved) -> Iterator[Finding]:
    """Check everything that an iteration with these settings needs. A missing part is a finding, never an error."""
    config, places = resolved.config, resolved.places
    arm = None if config.is_simulated else config.hw
    yield from _program(arm)
    yield from _machine(config, places, arm)
    if arm is None:
        yield ok(checks.DEVICES, "arm, camera, bench", "the simulated lab has its own")
        yield from checks.not_needed(
            ("driver", "rig file", "real-time kernel", "network", "arm", "pedal", "balance", "camera")
        )
        yield from _task(config)
        return
    try:
        rig = rig_of(config, tasks_with_tools())
    except UsageError as error:
        fix = f"adaptsim config init --arm {arm}, or correct the file"
        yield missing(checks.DEVICES, "rig file", str(error), fix)
        yield skipped(checks.DEVICES, "all devices", "not checked: without a rig file the devices are unknown")
        yield from _task(config)
        return
    yield from _devices(config, places, rig)
    yield from _task(config)
    yield _motion(resolved)


def _devices(config: Config, places: Places, rig: RigDescription) -> Iterator[Finding]:
    yield ok(checks.DEVICES, "rig file", f"{config.rig}: {rig.name}, {rig.arm.model} at {rig.arm.address}")
    yield from checks.required(rig, config.task)
    known = KnownArm(folder_of(places, rig)).read()
    yield checks.stop_button(known, "stop_button" in rig.waived, datetime.now(UTC))
    trips = readings.round_trips(rig.arm.address)
    yield checks.network(rig.arm.address, trips)
    yield _arm(rig, reached=bool(trips.times_ms))
    yield from _camera(rig)
    yield _calibration(config, places)
    yield from _pedal(rig)
    yield from _balance(rig)


def _program(arm: str | None) -> Iterator[Finding]:
    about = importlib.metadata.metadata("adaptsim")
    yield checks.python(platform.python_version(), about["Requires-Python"])
    yield checks.packages(importlib.metadata.requires("adaptsim") or (), readings.installed)
    yield checks.libraries(readings.loads)
    if arm is not None:
        yield checks.driver(arm, readings.installed)


def _machine(config: Config, places: Places, arm: str | None) -> Iterator[Finding]:
    folder = readings.existing(places.data)
    yield checks.disk(str(folder), shutil.disk_usage(folder).free // 1_000_000, config.min_free_mb)
    yield checks.disk_speed(str(folder), readings.write_speed(folder))
    if arm is not None:
        from hw.franka.realtime import kernel_is_real_time

        yield checks.realtime_kernel(os.uname().release, kernel_is_real_time())
        yield checks.priorities(readings.limits())
        yield checks.governor(readings.governors())


def _task(config: Config) -> Iterator[Finding]:
    from adaptsim_cli.wiring.checkpoints import checkpoint_of
    from sim.lab.world import load_world
    from sim.tasks import get_task

    def checkpoint() -> str:
        found = checkpoint_of(config)
        return f"{config.task}/{found.path.name} fits, sha256 {found.sha256[:12]}"

    def world() -> str:
        return f"{load_world(config.lab_world, get_task(config.task)).name} of {config.task}"

    wrong = (SimError, OSError)
    yield checks.attempt(
        "checkpoint", checkpoint, wrong, f"adaptsim pretrain --task {config.task}, or leave checkpoint out"
    )
    if config.lab_world:
        yield checks.attempt("world", world, wrong, f"adaptsim lab list --task {config.task}")


def _arm(rig: RigDescription, *, reached: bool) -> Finding:
    """Check the arm over FCI, without a motion."""
    if not reached:
        return skipped(checks.DEVICES, "arm", "not asked: its address does not answer")
    from hw.franka.inspection import inspect
    from hw.franka.realtime import kernel_is_real_time

    try:
        seen = inspect(rig.arm.model, rig.arm.settings(), realtime=kernel_is_real_time())
    except DeviceUnavailable as error:
        return missing(
            checks.DEVICES, "arm", str(error), "unlock the joints and activate FCI in Desk; docs/guide/arms.md"
        )
    return checks.arm(seen, rig.arm.model)


def _camera(rig: RigDescription) -> Iterator[Finding]:
    from hw.camera.probe import probe_k4a

    found = checks.camera(probe_k4a(patience_s=LOOK_S), rig.camera.serial)
    yield found
    if found.fix:
        return
    yield _stream(CameraProcess(rig.camera.serial or None, rig.camera.settings()))


def _stream(camera: CameraProcess) -> Finding:
    """Check half a second of images."""
    try:
        with camera:
            camera.start_recording()
            time.sleep(STREAM_S)
            camera.stop_recording()
            return checks.stream(camera.facts(), STREAM_S)
    except (CameraError, DeviceUnavailable) as error:
        return missing(checks.DEVICES, "camera images", str(error), "docs/guide/cameras.md: USB, power, display")


def _calibration(config: Config, places: Places) -> Finding:
    try:
        known = wiring_calibration.current_calibration(config, places)
    except (SessionError, CalibrationError) as error:
        return missing(checks.DEVICES, "calibration", str(error), f"adaptsim calibrate --hw {config.hw}")
    return checks.calibration(known, config.calibration_days, datetime.now(UTC), config.hw)


def _pedal(rig: RigDescription) -> Iterator[Finding]:
    if rig.pedal is None:
        return  # a finding of `checks.required`
    from hw.serial.enable_pedal import EnablePedal
    from hw.serial.pedal_protocol import VERSION

    port = rig.pedal.port
    found = checks.serial_port("pedal", port, readings.port(Path(port)), serial_ports(Path("/dev")))
    yield found
    if found.fix:
        return

    def greeting() -> str:
        with EnablePedal(port) as pedal:
            return f"answers, protocol version {VERSION}; {'held' if pedal.enabled() else pedal.why_not()}"

    yield checks.answers("pedal", greeting, (DeviceUnavailable,), "docs/guide/enable-pedal.md: cable, board, sketch")


def _balance(rig: RigDescription) -> Iterator[Finding]:
    if rig.balance is None:
        yield skipped(checks.DEVICES, "balance", "the rig file names none: the object's mass is not recorded")
        return
    from hw.serial.balance import SerialBalance

    part = rig.balance
    found = checks.serial_port("balance", part.port, readings.port(Path(part.port)), serial_ports(Path("/dev")))
    yield found
    if found.fix:
        return

    def weigh() -> str:
        with SerialBalance(part.port, part.protocol) as balance:
            try:
                return f"answers, {balance.mass_kg():.4f} kg on it"
            except BalanceError as error:
                return f"answers: {error}"

    yield checks.answers("balance", weigh, (DeviceUnavailable,), "switch it on; [balance] protocol in the rig file")


def _motion(resolved: Resolved) -> Finding:
    """Whether the task is possible in the session's workcell: the middle action at the reference context."""
    from adaptsim_cli.wiring.motion import mounted_for, planned

    task = resolved.config.task

    def plan() -> str:
        made = planned(mounted_for(resolved, None), (), ())
        worst = max((report.worst for report in made.reports), key=lambda check: check.ratio)
        return f"{task} can be done with this tool and these boxes, {100 * worst.ratio:.0f} % of the tightest limit"

    wrong = (SimError, MotionRefused, UsageError, SessionError, PreflightFailed, CalibrationError)
    return checks.attempt("motion", plan, wrong, "[tools], [table], [person] and [[keep_out]] of the rig file")


_MARKS = {
    Severity.OK: ("✓", "green"),
    Severity.ADVICE: ("!", "yellow"),
    Severity.MISSING: ("✗", "bold red"),
    Severity.SKIPPED: ("–", "dim"),
}


def show(found: Sequence[Finding], config: Config, screen: Screen) -> None:
    """Show the table, then each remedy on an unwrapped line, so that it can be copied."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    table.add_column(width=1)
    table.add_column(min_width=17)
    table.add_column(overflow="fold")
    for group, findings in groupby(found, key=lambda finding: finding.group):
        table.add_row("", Text(group, style="bold"), "")
        for finding in findings:
            table.add_row(Text(*_MARKS[finding.verdict]), finding.name, Text(finding.detail, style=_style(finding)))
    screen.show(views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw))
    screen.show(table)
    for verdict, head in ((Severity.MISSING, "Missing:"), (Severity.ADVICE, "Recommended:")):
        remedies = [finding for finding in found if finding.verdict is verdict]
        if remedies:
            screen.show(Text(f"\n{head}", style="bold"))
        for finding in remedies:
            screen.plain(f"  {finding.name}: {finding.fix}")
    if not _missing(found):
        screen.plain("\nReady")
        screen.next((f"adaptsim run-iteration {same_lab(config.task, config.hw, config.world)}", "the first trials"))


def as_json(found: Sequence[Finding], config: Config) -> dict[str, Any]:
    """The checklist for `doctor --json`."""
    checks = [
        {"group": f.group, "name": f.name, "verdict": f.verdict.value, "detail": f.detail, "fix": f.fix} for f in found
    ]
    return {"ready": not _missing(found), "hw": config.hw, "task": config.task, "checks": checks}


def require(found: Sequence[Finding]) -> None:
    """Raises PreflightFailed naming what is missing."""
    if names := _missing(found):
        raise PreflightFailed(f'not ready: {", ".join(names)}. Each remedy is listed above, and under "fix" in --json')


def _missing(found: Sequence[Finding]) -> list[str]:
    return [finding.name for finding in found if finding.verdict is Severity.MISSING]


def _style(finding: Finding) -> str:
    return "dim" if finding.verdict is Severity.SKIPPED else ""
