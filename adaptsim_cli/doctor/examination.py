"""The whole checklist, in the order of the screen."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
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
from hw.camera.process import CameraProcess, open_kinect
from hw.errors import BalanceError, CameraError, DeviceUnavailable, MotionRefused
from sim.errors import SimError

STREAM_S = 0.5
LOOK_S = 5.0
"""How long libk4a may take to list its cameras."""


def examine(resolved: Resolved) -> Iterator[Finding]:
    """Check everything that an iteration with these settings needs. A missing part is a finding, never an error."""
    config, places = resolved.config, resolved.places
    arm = None if config.is_simulated else config.hw
    yield from program(arm)
    yield from machine(config, places, arm)
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
        fix = f"adaptsim setup --hw {arm}, or correct the file"
        yield missing(checks.DEVICES, "rig file", str(error), fix)
        yield skipped(checks.DEVICES, "all devices", "not checked: without a rig file the devices are unknown")
        yield from _task(config)
        return
    yield from _devices(config, places, rig)
    yield from _task(config)
    yield motion(resolved)


def _devices(config: Config, places: Places, rig: RigDescription) -> Iterator[Finding]:
    yield ok(checks.DEVICES, "rig file", f"{config.rig}: {rig.name}, {rig.arm.model} at {rig.arm.address}")
    yield from checks.required(rig, config.task)
    yield stop_button(places, rig)
    yield from arm(rig)
    yield from camera(rig)
    yield calibration(config, places)
    yield from pedal(rig)
    yield from balance(rig)


def program(arm: str | None) -> Iterator[Finding]:
    """Python, its packages and libraries, and the driver of a real arm."""
    about = importlib.metadata.metadata("adaptsim")
    yield checks.python(platform.python_version(), about["Requires-Python"])
    yield checks.packages(importlib.metadata.requires("adaptsim") or (), readings.installed)
    yield checks.libraries(readings.loads)
    if arm is not None:
        yield checks.driver(arm, readings.installed)


def machine(config: Config, places: Places, arm: str | None) -> Iterator[Finding]:
    """Disk, and for a real arm the real-time properties of this computer."""
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


def stop_button(places: Places, rig: RigDescription) -> Finding:
    """When the arm's stop button was last found to stop it."""
    known = KnownArm(folder_of(places, rig)).read()
    return checks.stop_button(known, "stop_button" in rig.waived, datetime.now(UTC))


def arm(rig: RigDescription) -> Iterator[Finding]:
    """Whether the arm's address answers, and its state over FCI; without a motion."""
    trips = readings.round_trips(rig.arm.address)
    yield checks.network(rig.arm.address, trips)
    yield _over_fci(rig) if trips.times_ms else skipped(checks.DEVICES, "arm", "not asked: its address does not answer")


def _over_fci(rig: RigDescription) -> Finding:
    from hw.franka.inspection import inspect
    from hw.franka.realtime import kernel_is_real_time

    try:
        seen = inspect(rig.arm.model, rig.arm.settings(), realtime=kernel_is_real_time())
    except DeviceUnavailable as error:
        return missing(
            checks.DEVICES, "arm", str(error), "unlock the joints and activate FCI in Desk; docs/guide/arms.md"
        )
    return checks.arm(seen, rig.arm.model)


def camera(rig: RigDescription) -> Iterator[Finding]:
    """The camera of the rig, its firmware, and half a second of its images."""
    from hw.camera.probe import probe_k4a

    found = checks.camera(probe_k4a(patience_s=LOOK_S), rig.camera.serial)
    yield found
    if found.fix:
        return
    yield _stream(open_kinect(rig.camera.serial or None, rig.camera.settings()))


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


def calibration(config: Config, places: Places) -> Finding:
    """Presence, error and age of the calibration."""
    try:
        known = wiring_calibration.current_calibration(config, places)
    except (SessionError, CalibrationError) as error:
        return missing(checks.DEVICES, "calibration", str(error), f"adaptsim calibrate --hw {config.hw}")
    return checks.calibration(known, config.calibration_days, datetime.now(UTC), config.hw)


def pedal(rig: RigDescription) -> Iterator[Finding]:
    """The pedal's port, and whether it answers; nothing without a pedal."""
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


def balance(rig: RigDescription) -> Iterator[Finding]:
    """The balance's port, and whether it answers."""
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


def motion(resolved: Resolved) -> Finding:
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
    screen.show(views.badge(config.hw, "simulated lab" if config.is_simulated else config.hw))
    table = _table()
    for group, findings in groupby(found, key=lambda finding: finding.group):
        table.add_row("", Text(group, style="bold"), "")
        _fill(table, findings)
    screen.show(table)
    _remedies(found, screen)
    if not missing_in(found):
        screen.plain("\nReady")
        screen.next((f"adaptsim run-iteration {same_lab(config.task, config.hw, config.world)}", "the first trials"))


def show_few(found: Sequence[Finding], screen: Screen) -> None:
    """Show a few findings, without the groups, and their remedies."""
    table = _table()
    _fill(table, found)
    screen.show(table)
    _remedies(found, screen)


def _table() -> Table:
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    table.add_column(width=1)
    table.add_column(min_width=17)
    table.add_column(overflow="fold")
    return table


def _fill(table: Table, found: Iterable[Finding]) -> None:
    for finding in found:
        table.add_row(Text(*_MARKS[finding.verdict]), finding.name, Text(finding.detail, style=_style(finding)))


def _remedies(found: Sequence[Finding], screen: Screen) -> None:
    for verdict, head in ((Severity.MISSING, "Missing:"), (Severity.ADVICE, "Recommended:")):
        remedies = [finding for finding in found if finding.verdict is verdict]
        if remedies:
            screen.show(Text(f"\n{head}", style="bold"))
        for finding in remedies:
            screen.plain(f"  {finding.name}: {finding.fix}")


def as_json(found: Sequence[Finding], config: Config) -> dict[str, Any]:
    """The checklist for `doctor --json`."""
    checks = [
        {"group": f.group, "name": f.name, "verdict": f.verdict.value, "detail": f.detail, "fix": f.fix} for f in found
    ]
    return {"ready": not missing_in(found), "hw": config.hw, "task": config.task, "checks": checks}


def require(found: Sequence[Finding]) -> None:
    """Raises PreflightFailed naming what is missing."""
    if names := missing_in(found):
        raise PreflightFailed(f'not ready: {", ".join(names)}. Each remedy is listed above, and under "fix" in --json')


def missing_in(found: Sequence[Finding]) -> list[str]:
    """The names of what is missing."""
    return [finding.name for finding in found if finding.verdict is Severity.MISSING]


def _style(finding: Finding) -> str:
    return "dim" if finding.verdict is Severity.SKIPPED else ""
