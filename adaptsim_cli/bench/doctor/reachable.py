"""The devices that this computer can reach, each with its entry in the rig file."""

from __future__ import annotations

from pathlib import Path

from adaptsim_cli.bench.doctor import readings
from adaptsim_cli.bench.rig_file.devices import BALANCE, PEDAL
from adaptsim_cli.bench.rig_file.reading import rig_of, tasks_with_tools
from adaptsim_cli.config import Config, is_own, is_simulated
from hw.camera.kinds import CAMERAS

PORT = "serial port"

Row = dict[str, str]
"""device, name, found, entry"""


def is_arm(hw: str) -> bool:
    """Whether the hardware is an arm with an address in the rig file."""
    return not is_simulated(hw) and not is_own(hw)


def camera_kinds() -> tuple[str, ...]:
    """Every kind of camera that the program knows."""
    return tuple(CAMERAS.names())


def cameras(kind: str) -> list[Row]:
    """The cameras of a kind that are plugged in; one row with the reason if they cannot be listed."""
    report = readings.cameras(kind)
    label = f"camera, {CAMERAS.get(kind).label}"
    if not report.devices:
        fix = report.fix if report.fix and report.fix not in (report.error or "") else ""
        why = ". ".join(part for part in (report.error, fix) if part)
        return [_row(label, "none", why or "none is plugged in", "")]
    return [
        _row(
            label,
            device.serial or f"number {device.index}",
            device.error or f"firmware {device.firmware or 'not reported'}",
            f'[camera] kind = "{kind}", serial = "{device.serial}"' if device.serial else "",
        )
        for device in report.devices
    ]


def ports(dev: Path) -> list[Row]:
    """The serial ports of USB devices in `dev`. If the cable's name identifies the device, the row has its entry for
    the rig file.
    """
    rows = []
    for port in readings.serial_ports(dev):
        part = next((kind for kind in (PEDAL, BALANCE) if readings.like([port], kind.cables)), None)
        guess = "a serial port" if part is None else f"a serial port, by its cable the {part.label}"
        entry = "" if part is None else f'[{"pedal" if part is PEDAL else "balance"}] port = "{port}"'
        rows.append(_row(PORT, port, guess, entry))
    return rows


def arm(config: Config) -> Row:
    """The arm at the address of the rig file. Raises UsageError without a rig file."""
    part = rig_of(config, tasks_with_tools()).arm
    times_ms, lost, problem = readings.round_trips(part.address)
    answer = f"answers in {min(times_ms):.2f} ms, {lost} lost" if times_ms else f"does not answer: {problem}"
    return _row("arm", part.address, answer, f'[arm] address = "{part.address}"')


def _row(device: str, name: str, answer: str, entry: str) -> Row:
    return {"device": device, "name": name, "answer": answer, "entry": entry}
