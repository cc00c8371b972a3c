"""Calibrations and touch-offs by name: listed, compared, restored; and sessions that go on with their own."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from real_lab import ToyDevices, calibrated, calibration, waivers, write_rig

from adaptsim_cli import config
from adaptsim_cli.bench.calibration_in_use import calibrations
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.rig_frames import ground_of
from adaptsim_cli.bench.touch_off.solving import MeasuredValue
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.bench.touch_off_in_use import correction_by, origin, touch_off_of, touch_offs
from adaptsim_cli.commands.app import run
from adaptsim_cli.config import Places, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.records import SessionFacts
from adaptsim_cli.session.rig_sessions import own_ground
from calib.saved import SavedCalibration
from hw.types import Array
from sim.tasks import get_task

WORLD = ["--task", "scooping", "--world", "ood-1", "--seed", "0"]


@pytest.fixture
def settings(place) -> Resolved:
    return config.load({"task": "scooping", "world": "ood-1", "seed": 0})


def moved(by_m: float) -> SavedCalibration:
    known = calibration()
    X_AC = np.array(known.X_AC)
    X_AC[0, 3] += by_m
    return known.model_copy(update={"X_AC": tuple(tuple(map(float, row)) for row in X_AC)})


def out(capfd: pytest.CaptureFixture[str]) -> str:
    return " ".join(capfd.readouterr().out.split())


def test_calibrations_are_listed_compared_and_restored(settings, capfd, printed):
    store = calibrations(settings.config, settings.places)
    assert run(["calibrate", "list", *WORLD]) == 0
    assert "No calibrations yet in" in out(capfd)
    store.save(calibration(), b"<p>")
    store.save(moved(0.01), b"<p>")
    found = printed("calibrate", "list", *WORLD, "--json")
    assert [(c["name"], c["in_use"]) for c in found["calibrations"]] == [
        ("calibration-0001", False),
        ("calibration-0002", True),
    ]
    assert run(["calibrate", "compare", "1", "2", *WORLD]) == 0
    told = out(capfd)
    assert "calibration-0002 has the camera 10.00 mm and 0.000° from calibration-0001" in told
    assert "the camera has moved" in told
    assert run(["calibrate", "restore", "1", *WORLD]) == 0
    assert "In use from now on: " in out(capfd)
    current = store.current()
    assert current is not None and current.X_AC == calibration().X_AC
    assert run(["calibrate", "list", *WORLD]) == 0
    assert "in use, copy of 1" in out(capfd)
    assert run(["calibrate", "show", "3", *WORLD]) == 0
    assert "The camera stands at" in out(capfd)
    for asked in (["show", "3"], ["compare", "1", "2"], ["restore", "2"]):
        assert run(["calibrate", *asked, *WORLD, "--json"]) == 0
        assert json.loads(out(capfd))["version"] == 1


def test_what_is_not_there_or_in_use_already_is_said(settings, refused):
    store = calibrations(settings.config, settings.places)
    store.save(calibration(), b"")
    assert "there is no calibration-0007" in refused(2, "calibrate", "restore", "7", *WORLD)
    assert "calibration-0001 is in use already" in refused(2, "calibrate", "restore", "calibration-0001", *WORLD)
    assert "there are: none yet" in refused(2, "touch-off", "restore", "1", *WORLD)


def test_a_damaged_one_is_named_and_hides_no_other(settings, printed):
    store = calibrations(settings.config, settings.places)
    path = store.save(calibration(), b"")
    store.save(calibration(), b"")
    (path / "calibration.json").write_text("{")
    found = printed("calibrate", "list", *WORLD, "--json")["calibrations"]
    assert "error" in found[0] and found[1]["in_use"]


def facts(ground_sha256: str) -> SessionFacts:
    return SessionFacts(
        name="s", task="scooping", hw="fake", world="ood-1", seed=0, method="adaptsim", particles=2, trials=2,
        created="2026-01-01T00:00:00+00:00", checkpoint="", checkpoint_sha256="", calibration="calibrated",
        calibration_sha256=ground_sha256, versions={}, title="t", object_name="o", parameters=(), context=(), action=(),
    )  # fmt: skip


def test_a_session_finds_its_own_calibration_among_all_that_are_kept(settings):
    task, store = get_task("scooping"), calibrations(settings.config, settings.places)

    def in_use() -> str:
        with open_lab(settings.config, task) as lab:
            return ground_of(settings.config, settings.places, task, lab).sha256

    def own(wanted: str, places: Places = settings.places) -> np.ndarray:
        with open_lab(settings.config, task) as lab:
            return own_ground(settings.config, places, task, lab, facts(wanted)).eye.X_BC

    nominal = in_use()
    store.save(calibration(), b"")
    first = in_use()
    store.save(moved(0.01), b"")
    second = in_use()
    assert len({nominal, first, second}) == 3
    assert own(second)[0, 3] - own(first)[0, 3] == pytest.approx(0.01)
    assert own(nominal)[0, 3] != own(first)[0, 3], "the calibration that came with the world"
    with pytest.raises(UsageError, match="is no longer kept; name another"):
        own("f" * 64, replace(settings.places))


def test_a_tool_without_corners_takes_the_table_from_the_touch_off_of_another_tool(place, kim):
    """The table of a real lab slopes by 0.3° and no pusher can touch it: tracks were off by 3.8 mm."""
    write_rig(place.parent / "home")
    rig = place.parent / "home" / "rig.toml"
    rig.write_text(rig.read_text() + waivers("payload"))
    scooping, pushing = (config.load({"task": task, "hw": "panda"}) for task in ("scooping", "pushing"))
    calibrated(pushing)
    zeros_rad = calibrations(pushing.config, pushing.places).current().offsets_rad()
    pusher = get_task("pushing")
    assert touch_off_of(pushing.config, pushing.places, pusher, zeros_rad) is None
    saved = touched(zeros_rad)
    touch_offs(scooping.config, scooping.places).save(saved)

    assert touch_off_of(pushing.config, pushing.places, pusher, zeros_rad) == saved
    with open_lab(pushing.config, pusher, ToyDevices().drivers()) as lab:
        correction = correction_by(saved, lab.rig, pusher)
        ground = ground_of(pushing.config, pushing.places, pusher, lab)
    assert (correction.table.slope_x, correction.table.slope_y) == (0.0045, -0.0028)
    assert correction.height_m == correction.pitch_rad == 0.0, "the spatula's, not the pusher's"
    assert ground.mounted_task.cell.table == correction.table
    assert "The table comes from the touch-off of the scooping tool" in origin(saved, pusher)
    assert touch_off_of(scooping.config, scooping.places, get_task("scooping"), zeros_rad) == saved


def touched(zeros_rad: Array) -> SavedTouchOff:
    """A touch-off of a spatula, 0.9 mm too high in the hand, on a table that slopes."""
    value: dict[str, Any] = {name: MeasuredValue(value=v, within=1e-4) for name, v in VALUES.items()}
    return SavedTouchOff(
        created="2026-01-01T00:00:00+00:00", hw="panda", arm="panda", rig="r", tool="scooping tool", source="a test",
        table_origin_m=-0.0032, edge_over_table_m=1e-4, edge_too_high_m=1e-4, repeat_m=1e-5, misfit_m=1e-5,
        joint_zeros_rad=tuple(map(float, zeros_rad)), touches=(), versions={}, **value,
    )  # fmt: skip


VALUES = {
    "table_height_m": -0.0001, "tilt_x": 0.0045, "tilt_y": -0.0028, "tool_height_m": 0.0009, "tool_forward_m": 0.0011,
    "tool_pitch_rad": 0.010, "tool_roll_rad": -0.004,
}  # fmt: skip
