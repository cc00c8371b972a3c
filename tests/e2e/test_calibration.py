"""A whole calibration of the rendered lab by its command, and what it does for finding the object."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.commands import app
from hw.types import Array
from sim.lab.calibrating import nominal_X_BC
from sim.lab.kinect import default_X_BC
from sim.lab.simulated import SimulatedLab
from sim.lab.world import load_world
from sim.panda.planning import home
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

SENSING = """
[sensing]
extrinsic_error_mm = 3.0
extrinsic_error_deg = 0.3
encoder_noise_mrad = 0.1
joint_offset_mrad = 0.5
clock_offset_ms = 12.0
"""
PLACES_M = ((0.66, -0.02), (0.68, 0.015), (0.70, -0.01), (0.69, 0.02))


Json = dict[str, Any]


@pytest.fixture
def data_home(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def world(data_home, tmp_path) -> str:
    path = tmp_path / "offset.toml"
    path.write_text((resources.files("sim") / "worlds/scooping/wd.toml").read_text() + SENSING)
    return str(path)


def found_off_mm(world: str, X_BC: Array) -> float:
    task = get_task("scooping")
    hardware = task.require_hardware()
    tracker, cell, off = tracker_of(task), cell_as_shipped(hardware, "panda"), []
    home_rad = home(hardware.X_FT, cell, hardware.home_pitch_rad)
    with SimulatedLab(task, load_world(world, task), 1, cell, home_q_rad=home_rad) as lab:
        for trial, xy_m in enumerate(PLACES_M, start=1):
            lab.bench.place(np.array(xy_m), trial, 0)
            truth = np.array(lab.truth()["trials"][-1]["X_BO_placed"])[:2, 3]
            found = tracker.find(lab.camera.snapshot(), lab.camera.model(), X_BC)
            off.append(1e3 * float(np.linalg.norm(np.asarray(found.xy_m) - truth)))
    return float(np.mean(off))


@pytest.mark.slow
def test_the_command_finds_what_the_world_hides(world, capfd):
    here = ["--world", world, "--seed", "1", "--yes", "--json"]
    assert app.run(["calibrate", *here]) == 0
    found = json.loads(capfd.readouterr().out)
    X, truth = np.array(found["X_BC"]), default_X_BC()
    assert 1e3 * np.linalg.norm(X[:3, 3] - truth[:3, 3]) < 1.5
    points = np.array(found["uncertainty"]["points_m"])
    moved = X @ np.linalg.inv(truth)
    off_mm = 1e3 * np.linalg.norm(points @ moved[:3, :3].T + moved[:3, 3] - points, axis=1)
    assert off_mm.max() < found["worst_95_mm"]
    assert found["held_out_px"] < 0.35
    timing = next(check for check in found["checks"] if check["name"] == "time offset")
    assert timing["value"] == pytest.approx(12.0, abs=5.0)
    assert timing["verdict"] == "suspect"
    touched = next(check for check in found["checks"] if check["name"] == "touched point")
    assert touched["verdict"] == "good"
    assert touched["value"] < 1.5
    assert found["temperatures_C"] == {"arm": None, "camera": None}

    nominal = nominal_X_BC(load_world(world, get_task("scooping")), 1)
    before_mm, after_mm = found_off_mm(world, nominal), found_off_mm(world, X)
    assert after_mm < before_mm - 1.0, (before_mm, after_mm)

    assert app.run(["calibrate", "check", *here]) == 0
    assert json.loads(capfd.readouterr().out)["moved"] is False


WORLDS = Path(__file__).parents[1] / "data/worlds"


def guided(name: str, home: Path, capfd: pytest.CaptureFixture[str]) -> tuple[str, Json]:
    """A guided calibration of the rendered lab that is refused: its message, and the record of its views."""
    assert app.run(["calibrate", "--world", str(WORLDS / name), "--seed", "1", "--yes", "--json"]) == 3
    refused = capfd.readouterr().err
    (views,) = home.glob("data/calibrations/*/views-0001")
    assert app.run(["calibrate", "solve", str(views), "--json", "--out", str(home / "report.html")]) == 3
    return refused, json.loads(capfd.readouterr().out)


def off_mm(record: Json, name: str) -> Array:
    """By how much the corners of the work volume (8,) are off, with the base where the world's mount has it."""
    mount = load_world(str(WORLDS / name), get_task("pushing" if "noisy" in name else "scooping")).mount
    points_m = np.array(record["uncertainty"]["points_m"])
    moved = np.array(record["X_BC"]) @ np.linalg.inv(mount.true.X_BW @ default_X_BC())
    return np.asarray(1e3 * np.linalg.norm(points_m @ moved[:3, :3].T + moved[:3, 3] - points_m, axis=1))


@pytest.mark.slow
def test_joints_that_are_noisy_beyond_plausible_are_named_and_nothing_is_stored(data_home, capfd):
    refused, record = guided("biased-tilted-noisy.toml", data_home, capfd)
    assert "the arm's joints are off by 1.0 mrad from view to view" in refused
    assert "intrinsics" not in refused.rpartition("Error:")[2]
    assert off_mm(record, "biased-tilted-noisy.toml").max() < record["worst_95_mm"]


@pytest.mark.slow
def test_print_joint_zeros_clock_and_table_are_each_named_with_their_size(data_home, capfd):
    refused, record = guided("print-zeros-clock.toml", data_home, capfd)
    assert "stated error" in refused
    assert off_mm(record, "print-zeros-clock.toml").max() < record["worst_95_mm"]
    checks = {check["name"]: check["message"] for check in record["checks"]}
    assert "+0.20 %" in checks["square size"]
    late_ms = next(check["value"] for check in record["checks"] if check["name"] == "time offset")
    assert late_ms == pytest.approx(-60.0, abs=1.0)
    assert "the wrong table" in checks["table plane"]
    assert "The solution takes them into account" in checks["joint offsets"]
