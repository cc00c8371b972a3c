"""The lab's arm feels the table where it truly is, and says so when it does not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hw.collision import LEVEL, KeepOut
from hw.contact import began
from hw.errors import ArmFault, DeviceUnavailable, MotionRefused, NoContact, StoppedByPedal
from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.types import Array
from sim.errors import NotExecutable, UnknownName
from sim.lab.touch import TouchLab
from sim.lab.world import Faults, Mount, World, load_world
from sim.panda.moves import move_path
from sim.panda.tool import FINGERTIPS, cell_as_shipped, empty_hand
from sim.panda.touching import HeldTool, Probe, Stage, descent, stance
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
CELL = cell_as_shipped(HARDWARE, "panda").holding(empty_hand())
BENCH = HeldTool(CELL, np.eye(4))
XY_M = np.array([0.55, 0.1])
PROBE = Probe("table", FINGERTIPS, XY_M, np.diag([1.0, -1.0, -1.0]))
GUARD = BENCH.guard(FINGERTIPS, 4.0)
DOWN = (Stage(0.034, 0.015),)
MOUNT = Mount(table_height_mm=-4.0, table_rise_mrad=(3.0, -5.0))


@cache
def top_rad() -> Array:
    return stance(PROBE, BENCH, LEVEL, 0.020, DOWN, 4.0, np.array([0.2, 0.3, 0.0, -2.3, 0.0, 2.6, 0.9]))


def world(mount: Mount = MOUNT, faults: Faults | None = None) -> World:
    return replace(load_world("wd", TASK), mount=mount, faults=faults or Faults())


def lab(of: World, things: tuple[KeepOut, ...] = ()) -> TouchLab:
    return TouchLab(TASK, of, 3, CELL, home_q_rad=top_rad(), things=things)


def height_m(q_rad: Array) -> float:
    X = forward(q_rad)
    return float((X[:3, :3] @ GUARD.p_F_m + X[:3, 3])[2]) - FINGERTIPS.radius_m


def test_a_slow_touch_finds_the_true_table() -> None:
    slow = descent(top_rad(), (Stage(0.0205, 0.015), Stage(0.010, 0.0025)), GUARD, 0.005, CELL.arm)
    with lab(world()) as there:
        contact = there.arm.execute_until_contact(slow, GUARD)
        np.testing.assert_array_equal(there.arm.state().q_rad, top_rad())  # back where it began
        assert there.arm.state().t_s == pytest.approx(2.0 * contact.t_s)
    touch = began(contact, GUARD)
    assert touch is not None
    true_m = float(MOUNT.true.table.height_at(XY_M))
    assert height_m(touch.q_rad) == pytest.approx(true_m, abs=3e-4)  # three times the arm's repeatability
    assert 3.0 < contact.force_N < 9.0


def test_the_same_again_gives_the_same_and_another_touch_does_not() -> None:
    fast = descent(top_rad(), DOWN, GUARD, 0.014, CELL.arm)
    with lab(world()) as one, lab(world()) as other:
        first, again = (there.arm.execute_until_contact(fast, GUARD) for there in (one, other))
        second = one.arm.execute_until_contact(fast, GUARD)
    np.testing.assert_array_equal(first.felt_torque_Nm, again.felt_torque_Nm)
    assert not np.array_equal(first.felt_torque_Nm[:100], second.felt_torque_Nm[:100])


def test_something_on_the_table_is_felt_early_and_nothing_not_at_all() -> None:
    fast = descent(top_rad(), DOWN, GUARD, 0.014, CELL.arm)
    book = KeepOut("book", np.array([0.45, 0.0, 0.0]), np.array([0.65, 0.2, 0.012]))
    with lab(world(Mount()), (book,)) as there:
        assert height_m(there.arm.execute_until_contact(fast, GUARD).q_rad) == pytest.approx(0.012, abs=1e-3)
    with lab(world(Mount(table_height_mm=-40.0))) as there:
        with pytest.raises(NoContact, match="touched nothing"):
            there.arm.execute_until_contact(fast, GUARD)
        np.testing.assert_array_equal(there.arm.state().q_rad, top_rad())


def test_faults_stop_it_and_need_recovery() -> None:
    fast = descent(top_rad(), DOWN, GUARD, 0.014, CELL.arm)
    with lab(world(faults=Faults(arm_reflex=(1,), pedal_release=(2,)))) as there:
        with pytest.raises(ArmFault, match="reflex"):
            there.arm.execute_until_contact(fast, GUARD)
        stopped = there.arm.state()
        assert stopped.fault
        with pytest.raises(ArmFault, match="recover"):
            there.arm.execute_until_contact(fast, GUARD)
        there.arm.recover()
        there.arm._moved_to(top_rad(), 0.0)
        with pytest.raises(StoppedByPedal, match="pedal"):
            there.arm.execute_until_contact(fast, GUARD)
        assert np.abs(there.arm.state().q_rad - top_rad()).max() > 1e-4


def test_a_free_motion_into_the_table_is_a_fault() -> None:
    """The table stands 18 mm higher than the arm believes."""
    low = descent(top_rad(), (Stage(0.012, 0.015),), GUARD, 0.0, CELL.arm).q_rad[-1]
    with lab(world(Mount(table_height_mm=18.0))) as there, pytest.raises(ArmFault, match="hit the table"):
        there.arm.execute(move_path(top_rad(), low, LIMITS["panda"], 0.2))


def test_it_must_be_entered_and_contact_is_only_felt_out() -> None:
    fast = descent(top_rad(), DOWN, GUARD, 0.014, CELL.arm)
    there = lab(world())
    with pytest.raises(DeviceUnavailable):
        there.arm.execute_until_contact(fast, GUARD)
    with there, pytest.raises(MotionRefused):
        there.arm.execute(fast)


def test_a_task_without_corners_has_no_touch_off() -> None:
    pushing = get_task("pushing")
    with pytest.raises(UnknownName, match="no corners to touch"):
        TouchLab(pushing, load_world("wd", pushing), 0, CELL, home_q_rad=top_rad())


def test_a_place_out_of_reach_is_named() -> None:
    far = replace(PROBE, xy_m=np.array([1.1, 0.0]))
    with pytest.raises(NotExecutable, match="cannot touch at table"):
        stance(far, BENCH, LEVEL, 0.02, DOWN, 4.0, top_rad())
