"""`adaptsim find`: each device with its entry in the rig file."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptsim_cli.bench.doctor import reachable, readings
from adaptsim_cli.bench.rig_file.devices import PEDAL
from hw.camera.probe import FoundDevice, ProbeReport


def report(*devices: FoundDevice, error: str | None = None, fix: str | None = None) -> ProbeReport:
    return ProbeReport("lib.so", "1.4", "Microsoft", True, devices, error, fix)


def test_a_camera_has_its_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged = report(FoundDevice(0, "123", "colour 1.6"), FoundDevice(1, "", "", "another program uses it"))
    monkeypatch.setattr(readings, "cameras", lambda kind: plugged)
    first, second = reachable.cameras("k4a")
    assert (first["name"], first["entry"]) == ("123", '[camera] kind = "k4a", serial = "123"')
    assert (second["answer"], second["entry"]) == ("another program uses it", "")


def test_a_library_that_is_missing_is_named_once(monkeypatch: pytest.MonkeyPatch) -> None:
    absent = report(error="the library is missing: pip install x", fix="pip install x")
    monkeypatch.setattr(readings, "cameras", lambda kind: absent)
    (row,) = reachable.cameras("realsense")
    assert row["answer"] == "the library is missing: pip install x"


def test_a_port_whose_cable_names_the_pedal_has_its_entry(tmp_path: Path) -> None:
    by_id = tmp_path / "serial/by-id"
    by_id.mkdir(parents=True)
    for name in (f"usb-{PEDAL.cables[0]}-if00", "usb-unknown"):
        (by_id / name).write_text("")
    named, other = sorted(reachable.ports(tmp_path), key=lambda row: row["entry"], reverse=True)
    assert named["entry"].startswith('[pedal] port = "')
    assert other["entry"] == ""
