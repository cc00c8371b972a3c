"""A whole calibration of the rendered lab by its command, and what it does for finding the object."""

from __future__ import annotations

import json
from importlib import resources

import numpy as np
import pytest

from adaptsim_cli import app
from adaptsim_cli.devices.trackers import tracker_of
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


@pytest.fixture
def world(tmp_path, monkeypatch) -> str:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
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
