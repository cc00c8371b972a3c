"""What every arm that feels does: the fake one, the lab's, and the FR3 over its real network protocol."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cells import cell
from fr3_process import Fr3Process, arm_at
from guarded_paths import GUARD, Q_AWAY_RAD, Q_TOP_RAD, TIP, TOOL, TOP_M, approach, down, tip_m

from hw.collision import Table
from hw.contact import began, predicted_force_N
from hw.errors import ArmFault, DeviceUnavailable, MotionRefused, NoContact
from hw.fake import FakeArm, FakeClock
from hw.ports import GuardedArm
from hw.types import Guard
from sim.lab.touch import TouchLab
from sim.lab.world import Faults, Mount, load_world
from sim.tasks import get_task

CELL = cell(tool=TOOL)
SPEED_M_S = 0.004
PATH = down(0.004, SPEED_M_S)
PLANE_M, AIR_M = TOP_M - 0.002, -0.030


@dataclass(frozen=True)
class Kind:
    """How to get an arm at the path's start, over something at a height; and one that stops in its first search."""

    make: Callable[[float], GuardedArm]
    make_faulty: Callable[[], GuardedArm]
    error_m: float  # how far off a touch may be: the lab's joints are off by a little that is new at every touch
    rest_rad: float = 1e-6
    come: Callable[[GuardedArm], object] = lambda arm: None  # to the path's start, for an arm that is made elsewhere


def fake(height_m: float) -> GuardedArm:
    noise = 0.15 * np.random.default_rng(0).standard_normal((len(PATH.t_s), 7))
    return FakeArm(Q_TOP_RAD, FakeClock(), CELL, plane=Table(height_m), torque_Nm=noise)


def stopped_fake() -> GuardedArm:
    """The fake arm knows faults of free motions alone: it stops before the search."""
    arm = FakeArm(Q_TOP_RAD, FakeClock(), CELL)
    arm._fault = "reflex"
    return arm


def lab(height_m: float, faults: Faults | None = None) -> GuardedArm:
    task = get_task("scooping")
    world = replace(load_world("wd", task), mount=Mount(table_height_mm=1e3 * height_m), faults=faults or Faults())
    return TouchLab(task, world, 3, CELL, home_q_rad=Q_TOP_RAD).arm


KINDS = {
    "fake": Kind(fake, stopped_fake, 3e-4),
    "lab": Kind(lab, lambda: lab(PLANE_M, Faults(arm_reflex=(1,))), 6e-4),
}


def over_the_network(server: Fr3Process) -> Kind:
    def make(height_m: float) -> GuardedArm:
        server.place(Q_AWAY_RAD)
        server.plane(height_m, TIP)
        return arm_at(server, tool=TOOL)

    def make_faulty() -> GuardedArm:
        arm = make(PLANE_M)
        server.tell("threshold 2.0")
        return arm

    return Kind(make, make_faulty, 3e-4, rest_rad=1e-3, come=lambda arm: arm.execute(approach()))


@pytest.fixture(params=[*KINDS, pytest.param("fr3", marks=pytest.mark.long)])
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS.get(request.param) or over_the_network(request.getfixturevalue("hurried_fr3"))


def test_it_must_be_entered(kind: Kind) -> None:
    with pytest.raises(DeviceUnavailable):
        kind.make(PLANE_M).execute_until_contact(PATH, GUARD)


def test_a_touch_says_where_and_how_hard_and_the_arm_is_back(kind: Kind) -> None:
    with kind.make(PLANE_M) as arm:
        kind.come(arm)
        contact = arm.execute_until_contact(PATH, GUARD)
        np.testing.assert_allclose(arm.state().q_rad, Q_TOP_RAD, atol=2.0 * kind.rest_rad)
        assert arm.state().fault is None
    touch = began(contact, GUARD)
    assert touch is not None
    assert tip_m(touch.q_rad) == pytest.approx(PLANE_M, abs=kind.error_m)
    assert GUARD.force_N <= contact.force_N < predicted_force_N(GUARD, SPEED_M_S)
    assert contact.t_s == contact.felt_t_s[-1]
    np.testing.assert_allclose(np.diff(contact.felt_t_s), 1e-3, atol=1e-9)
    np.testing.assert_allclose(contact.felt_measured_rad, contact.felt_commanded_rad, atol=0.01)


def test_air_is_no_contact_and_the_arm_is_back(kind: Kind) -> None:
    with kind.make(AIR_M) as arm:
        kind.come(arm)
        before = arm.state()
        with pytest.raises(NoContact, match="touched nothing"):
            arm.execute_until_contact(PATH, GUARD)
        np.testing.assert_allclose(arm.state().q_rad, before.q_rad, atol=kind.rest_rad)
        assert arm.state().fault is None


def test_what_is_refused_moves_nothing(kind: Kind) -> None:
    with kind.make(PLANE_M) as arm:
        kind.come(arm)
        before = arm.state()
        for path, guard, match in (
            (PATH, Guard(49.0, TIP), "guard's force"),
            (down(0.005, 0.03), GUARD, "speed of the guarded point"),
            (replace(PATH, contact=None), GUARD, "no contact window"),
        ):
            with pytest.raises(MotionRefused, match=match):
                arm.execute_until_contact(path, guard)
        np.testing.assert_allclose(arm.state().q_rad, before.q_rad, atol=kind.rest_rad)
        assert arm.state().fault is None


def test_a_fault_stays_until_it_is_recovered(kind: Kind) -> None:
    with kind.make_faulty() as arm:
        kind.come(arm)
        for _ in range(2):
            with pytest.raises(ArmFault, match="recover"):
                arm.execute_until_contact(PATH, GUARD)
        stopped = arm.state()
        assert stopped.fault
        arm.recover()
        assert arm.state().fault is None
        np.testing.assert_allclose(arm.state().q_rad, stopped.q_rad, atol=kind.rest_rad)
