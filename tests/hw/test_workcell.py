"""The one value that says where an arm may move: what counts for reported joints and what for true ones."""

from __future__ import annotations

from dataclasses import MISSING, fields, replace

import numpy as np
import pytest
from cells import cell, find, stick
from fingertip_paths import Q_TOP_RAD, TOOL, down

from hw.collision import BARE_HAND, HAND_MASS, Table
from hw.errors import MotionRefused
from hw.mass import NOTHING, Mass, bar, box
from hw.types import ContactWindow, JointPath
from hw.workcell import ArmModel, Workcell, arm_model

ZEROS_RAD = np.array([0.003, -0.002, 0.001, 0.004, -0.003, 0.002, 0.0])
STILL = JointPath(np.array([0.0, 1e-3]), np.stack([Q_TOP_RAD, Q_TOP_RAD]))


def test_nothing_that_decides_may_be_left_out() -> None:
    for value in (Workcell, ArmModel):
        assert all(f.default is MISSING and f.default_factory is MISSING for f in fields(value))


def test_geometry_counts_for_true_joints_and_limits_for_reported_ones() -> None:
    exact, off = cell(tool=TOOL), cell(tool=TOOL, zeros_rad=ZEROS_RAD)
    reported = off.arm.reported(STILL)
    for quantity in ("self-collision", "table", "depth in the table"):
        one, other = find(reported, quantity, off), find(STILL, quantity, exact)
        assert (one.value, one.ratio) == pytest.approx((other.value, other.ratio), rel=1e-9)
    assert find(reported, "position", off) == find(reported, "position", exact)
    assert find(reported, "position", off) != find(STILL, "position", exact)


def test_a_planner_in_true_joints_is_told_the_same() -> None:
    off = cell("fr3", TOOL, zeros_rad=ZEROS_RAD)
    path = replace(down(), contact=ContactWindow(0.0, 1.0, 0.002, 20.0))
    for reported, true in zip(
        off.check(off.arm.reported(path)).checks, off.in_true_joints().check(path).checks, strict=True
    ):
        assert (reported.quantity, reported.where) == (true.quantity, true.where)
        assert reported.ratio == pytest.approx(true.ratio, rel=1e-6)
    np.testing.assert_array_equal(off.in_true_joints().arm.zeros_rad, np.zeros(7))


def test_what_it_holds_and_where_the_table_is_can_change() -> None:
    long = cell().holding(stick([0.0, 0.0, 0.14]))
    assert not long.check(STILL).ok
    assert long.over(Table(-0.04)).check(STILL).ok
    with pytest.raises(MotionRefused, match="stick"):
        long.require(STILL)


def test_an_arm_and_a_force_that_cannot_be() -> None:
    with pytest.raises(ValueError, match="arm 'ur5' is not known: it must be one of panda, fr3"):
        arm_model("ur5", np.zeros(7))
    with pytest.raises(ValueError, match="joint zeros"):
        arm_model("panda", np.zeros(6))


def test_bodies_add_up_about_their_common_centre() -> None:
    """Two halves of a box are the box; and a body seen from another frame turns with it."""
    whole = box(2.0, (0.2, 0.1, 0.05), (0.0, 0.0, 0.0))
    halves = box(1.0, (0.1, 0.1, 0.05), (-0.05, 0.0, 0.0)) + box(1.0, (0.1, 0.1, 0.05), (0.05, 0.0, 0.0))
    assert halves.kg == whole.kg
    np.testing.assert_allclose(halves.com_m, whole.com_m, atol=1e-15)
    np.testing.assert_allclose(halves.inertia_kg_m2, whole.inertia_kg_m2, atol=1e-15)
    X = np.array([[0.0, -1.0, 0.0, 0.3], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    turned = whole.placed(X)
    np.testing.assert_allclose(turned.com_m, [0.3, 0.0, 0.0])
    np.testing.assert_allclose(np.diag(turned.inertia_kg_m2), np.diag(whole.inertia_kg_m2)[[1, 0, 2]])
    stood = bar(2.0, (-0.1, 0.0, 0.0), (0.1, 0.0, 0.0), 0.1)
    np.testing.assert_allclose(stood.inertia_kg_m2, box(2.0, (0.2, 0.1, 0.1), (0.0, 0.0, 0.0)).inertia_kg_m2)
    assert (HAND_MASS + NOTHING).kg == BARE_HAND.mass.kg == 0.73
    with pytest.raises(ValueError, match="symmetric"):
        Mass(1.0, np.zeros(3), -np.eye(3))
