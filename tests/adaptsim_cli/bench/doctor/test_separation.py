"""The separation distance of ISO 13855, and sides that no box closes."""

from __future__ import annotations

import numpy as np
import pytest
from cells import READY, cell, joint, move
from real_lab import RIG, write_rig

from adaptsim_cli import config
from adaptsim_cli.bench.doctor.checks import examine
from adaptsim_cli.bench.doctor.separation import SideDistance, nearest_m, open_sides, separation_m
from adaptsim_cli.bench.doctor.table import Finding, Severity
from hw.collision import KeepOut, persons_side

REACH_M = 1.1


def wall(low: tuple[float, float], high: tuple[float, float], top_m: float = 2.0) -> KeepOut:
    return KeepOut(f"wall {low}", np.array([*low, -0.5]), np.array([*high, top_m]))


def test_a_person_walks_while_the_arm_stops():
    assert separation_m(0.5) == pytest.approx(1.6 * 0.5 + 0.85)
    assert SideDistance(0.6, 0.3, 1.6).line_m == pytest.approx(2.2)


def test_the_nearest_moment_of_a_motion_counts():
    box = persons_side("left", 0.6)
    near = nearest_m(box, cell(), (move(joint(1, 0.5)),))
    nearer = nearest_m(box, cell(), (move(joint(1, 0.5)), move(joint(1, 0.7), start_rad=READY + joint(1, 0.1))))
    assert 0.0 < nearer < near < 0.6


def test_a_side_is_open_until_boxes_cover_all_that_the_arm_reaches_there():
    assert open_sides((), REACH_M) == ("left", "right", "front", "back")
    assert open_sides((persons_side("left", 0.6),), REACH_M) == ("right", "front", "back")
    assert "left" in open_sides((persons_side("left", 0.9),), REACH_M), "it begins too far away"
    both = (wall((-2.0, 0.55), (0.0, 2.0)), wall((0.0, 0.55), (2.0, 2.0)))
    assert "left" not in open_sides(both, REACH_M)
    assert "left" in open_sides(both[:1], REACH_M), "half of a side is open"
    assert "left" in open_sides((wall((-2.0, 0.55), (2.0, 2.0), 0.5),), REACH_M), "the arm reaches over it"


def found(place, text: str) -> Finding:
    write_rig(place.parent / "home", text)
    *_, finding = examine(config.load({"hw": "panda", "task": "scooping"}), ("rig file", "sides"))
    return finding


def test_the_doctor_says_that_boxes_leave_the_persons_side_open(place):
    closed = found(place, RIG)
    assert closed.verdict is Severity.OK
    assert "side (left) is closed from 0.6 m; no box closes right, front, back" in closed.detail
    assert "Separation distance 1.60 m" in closed.detail
    opened = found(place, RIG.replace('side = "left"', 'side = "left"\nfrom_m = 0.95'))
    assert opened.verdict is Severity.ADVICE
    assert "no box closes left, right, front, back" in opened.detail
    assert "does not keep the arm off the operator's own side" in opened.detail
