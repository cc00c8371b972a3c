"""The risk assessment: one page with the rig's own numbers, and every waived check in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from real_lab import RIG, calibrated, own_place, quiet, said, write_rig

from adaptsim_cli import config
from adaptsim_cli.devices.known_arm import ArmFacts
from adaptsim_cli.devices.mounted import mounted
from adaptsim_cli.devices.rig_file.reading import read
from adaptsim_cli.doctor import assessment
from adaptsim_cli.doctor.assessment import Motions, hazards, page
from adaptsim_cli.errors import UsageError
from hw.braking import STOP_S
from sim.tasks import get_task

MOVES = Motions(0.8, 0.25, 0.8 * STOP_S, 12.0)


def test_every_hazard_has_a_measure_here_and_one_that_stays_with_the_lab(tmp_path: Path) -> None:
    full = RIG + '[[keep_out]]\nname = "lamp"\nlow_m = [0.5, -0.9, 0.6]\nhigh_m = [0.7, -0.7, 1.0]\n'
    rig = read(write_rig(tmp_path, full.replace('"keep_out", ', "")))
    for row in hazards(rig, MOVES):
        assert row.here, row
        assert row.lab, row
    bare = read(write_rig(tmp_path, 'waived = ["pedal", "hand", "person", "slow_start"]\n' + RIG[: RIG.index("waived")]
                          + RIG[RIG.index("[arm]") : RIG.index("[pedal]")]))  # fmt: skip
    waived = " ".join(row.here for row in hazards(bare, MOVES))
    for words in ("no enabling pedal", "no side of a person", "no hand is watched", "no slow first motion"):
        assert f"WAIVED: {words}" in waived


def test_the_page_has_the_rigs_own_numbers(tmp_path: Path) -> None:
    rig = read(write_rig(tmp_path))
    there = mounted(get_task("scooping"), rig, np.zeros(7))
    text = page(there, rig, MOVES, ArmFacts("2026-03-01T08:00:00+00:00", "Kim"))
    for words in (
        "lab-1, panda at 172.16.0.2, scooping",
        "0.80 m/s",
        "at most 32 cm of travel",
        "stops by itself at 80 N",
        "payload in the hand: 0.12 kg",
        "2026-03-01T08:00:00+00:00 Kim",
        "waived by the rig file: keep_out, stop_button, slow_start",
        "the person's side (left)",
        "| safety officer |",
    ):
        assert words in text


@pytest.mark.long
def test_the_command_plans_a_motion_and_writes_a_new_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place, screen = own_place(tmp_path, monkeypatch), quiet()
    write_rig(place)
    there = config.load({"hw": "panda", "task": "scooping"})
    calibrated(there)
    assessment.write(there, place / "risk.md", screen)
    assert "Written" in said(screen)
    assert "largest speed of the tool" in (place / "risk.md").read_text()
    with pytest.raises(UsageError, match="exists already"):
        assessment.write(there, place / "risk.md", screen)
    with pytest.raises(UsageError, match="hurts nobody"):
        assessment.write(config.load({"hw": "fake"}), place / "other.md", screen)
