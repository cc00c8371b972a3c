"""The risk assessment: one sheet with the rig's own numbers, and every waived check in it."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from real_lab import RIG, calibrated, waivers, write_rig

from adaptsim_cli import config
from adaptsim_cli.bench.devices.known_arm import ArmFacts, SetUp, StopMeasurement
from adaptsim_cli.bench.devices.mounted import mounted_task_of
from adaptsim_cli.bench.doctor.assessment import Motions, page
from adaptsim_cli.bench.rig_file.reading import read
from adaptsim_cli.bench.rig_file.waivers import WITHOUT, Waivable
from adaptsim_cli.commands import app
from hw.stopping import WorstStop
from sim.tasks import get_task

USAGE = 2
GUIDE = Path(__file__).parents[4] / "docs" / "guide" / "rig.md"
STOP = WorstStop(0.41, 0.21, 0.83, 0.29, "tip of spatula")
MOVES = Motions(7, 0.8, STOP, 12.0, 0.2)
BARE = RIG[: RIG.index("consent")] + RIG[RIG.index("[arm]") : RIG.index("[pedal]")] + waivers(*get_args(Waivable))


def sheet(folder: Path, rig_text: str = RIG, moves: Motions = MOVES, known: ArmFacts | None = None) -> str:
    """The text of the sheet of a rig, without marks, on one line."""
    rig = read(write_rig(folder, rig_text))
    facts = known or ArmFacts("2026-03-01T08:00:00+00:00", "Kim")
    text = page(
        mounted_task_of(get_task("scooping"), rig, np.zeros(7)), rig, moves, facts, {"set-up": "abc"}, SetUp("scooping")
    )
    return " ".join(html.unescape(re.sub(r"<style>.*</style>|<[^>]*>", " ", text, flags=re.DOTALL)).split())


def test_the_sheet_has_the_rigs_own_numbers(tmp_path):
    text = sheet(tmp_path)
    for words in (
        "lab-1, panda at 172.16.0.2, scooping",
        "0.80 m/s; any motion of the flange above 1.7 m/s",
        "at most 0.41 s and 21 cm: tip of spatula goes farthest",
        "any motion that the program accepts at most 0.47 s",
        "80 N; 60, 60, 54, 54, 10, 10, 10 Nm",
        "400 N, estimated",
        "payload in the hand 0.12 kg",
        "2026-03-01T08:00:00+00:00 by Kim",
        "the person's side (left)",
    ):
        assert words in text


def test_what_the_stop_button_was_measured_to_do_stands_beside_the_worst_case(tmp_path):
    assert "measured in a slow motion never: adaptsim setup --hw panda --from stop" in sheet(tmp_path)
    stop = StopMeasurement("2026-03-01T08:00:00+00:00", "Kim", 0.09, 0.011, 0.2, 0.05)
    text = sheet(tmp_path, known=ArmFacts(stop=stop))
    assert "to rest in 0.09 s and 11 mm, within the worst case of 0.20 s and 50 mm (2026-03-01, Kim)" in text


def test_the_separation_distance_stands_beside_the_side_and_says_when_that_is_nearer(tmp_path):
    text = sheet(tmp_path)
    assert "1.6 m/s × 0.47 s + 0.85 m 1.60 m." in text
    assert "side begins 0.60 m from the axis; these motions come within 0.20 m of it. The side is nearer" in text
    assert "stay behind a line 2.20 m from the axis" in text
    assert "right, front, back" in text
    far = replace(MOVES, nearest_m=1.61)
    assert "That is farther." in sheet(tmp_path, moves=far)
    assert "The side is nearer" not in sheet(tmp_path, moves=far)
    bare = sheet(tmp_path, BARE, moves=replace(MOVES, nearest_m=None))
    assert "names no side for a person: nothing keeps the arm this far away" in bare


def test_a_blade_fails_on_pressure_and_the_face_is_severity_3(tmp_path):
    text = sheet(tmp_path)
    assert "an edge 1.2 mm wide over a finger's width of 10 mm. Broken limits: " in text
    assert "pressure, struck" in text
    row = text[text.index("hands and fingers 140 N 80 N 190 N/cm² 667 280 N") :]
    assert row[: row.index("thighs")].rstrip().endswith("pressure, clamped; pressure, struck")
    assert re.search(r"struck in face or eyes by the tool: an edge 1.2 mm wide at up to 0.80 m/s S3 rare", text)
    assert "skull and forehead 130 N 80 N 110 N/cm² 667 not allowed" in text


def test_what_is_waived_is_no_measure_and_has_its_own_line(tmp_path):
    assert set(WITHOUT) == set(get_args(Waivable))
    bare, full = sheet(tmp_path, BARE), sheet(tmp_path, RIG)
    for name in get_args(Waivable):
        assert f"waived: {name}" in bare
        assert f"{name} {WITHOUT[name]}" in bare
        assert (WITHOUT[name] in full) == (name in ("keep_out", "stop_button", "slow_start"))
    assert "only while the pedal is held" in full
    assert "only while the pedal is held" not in bare


@pytest.mark.slow
def test_the_command_plans_with_the_rig_of_the_guide_and_writes_a_new_file(place, kim):
    write_rig(place.parent / "home", GUIDE.read_text().split("```toml\n")[1].split("```")[0])
    calibrated(config.load({"hw": "fr3", "task": "scooping"}))
    command = ["doctor", "--hw", "fr3", "--task", "scooping", "--assessment", "risk.html"]
    assert app.run(command) == 0
    text = (place / "risk.html").read_text()
    assert int(re.search(r"in (\d+) planned motions", text)[1]) >= 5
    assert "the camera</td>" in text
    assert re.search(r"at most 0\.\d\d s and \d+ cm: \S.* goes farthest", text)
    assert "The side is nearer than the separation distance" in text
    assert app.run(command) == USAGE
    assert app.run(["doctor", "--assessment", "other.html"]) == USAGE
    assert not (place / "other.html").exists()
