"""What every arm does: the real class over a player that needs no time, the lab's, and the FR3 over its real network
protocol run the same cases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import plain_lab
import pytest
from cells import cell
from fr3_process import Fr3Process, arm_at
from players import InstantArm

from hw.errors import ArmFault, DeviceUnavailable, MotionRefused
from hw.joint_limits import LIMITS
from hw.ports import Arm
from hw.types import ContactWindow, JointPath
from sim.lab.simulated import READY_RAD, SimulatedLab
from sim.lab.world import Faults
from sim.panda.moves import move_path

AWAY_RAD = READY_RAD + np.array([0.1, -0.1, 0.05, 0.1, 0.0, 0.1, -0.2])


TOUCHING = ContactWindow(0.0, 0.5, 0.001, 5.0)


@dataclass(frozen=True)
class Kind:
    """How to get an arm at the ready pose: one that is fine, and one that stops in its first motion with `contact`."""

    make: Callable[[], Arm]
    make_faulty: Callable[[], Arm]
    model: str = "panda"
    rest_rad: float = 1e-6  # how far gravity bends an arm that is said to stand at a posture
    rest_rad_s: float = 1e-6
    contact: ContactWindow | None = TOUCHING  # None: an arm that has to move freely before


def instant(*, faulty: bool) -> Arm:
    return InstantArm(READY_RAD, cell(), faults={1: "reflex"} if faulty else {})


def lab(*, faulty: bool) -> Arm:
    faults = Faults(arm_reflex=(1,)) if faulty else None
    built = SimulatedLab(plain_lab.TASK, plain_lab.world(faults=faults), 0, plain_lab.CELL)
    built.bench.place(plain_lab.XY_M, trial=1, attempt=0)
    return built.arm


KINDS = {
    "instant": Kind(lambda: instant(faulty=False), lambda: instant(faulty=True), contact=None),
    "lab": Kind(lambda: lab(faulty=False), lambda: lab(faulty=True)),
}


def over_the_network(server: Fr3Process) -> Kind:
    def make(fault: str = "") -> Arm:
        server.place(READY_RAD)
        if fault:
            server.tell(fault)
        return arm_at(server)

    return Kind(make, lambda: make("reflex 0.5 joint_reflex"), "fr3", rest_rad=1e-3, rest_rad_s=1e-2, contact=None)


@pytest.fixture(params=[*KINDS, pytest.param("fr3", marks=pytest.mark.long)])
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS.get(request.param) or over_the_network(request.getfixturevalue("server"))


@pytest.fixture
def there(kind: Kind) -> JointPath:
    return move_path(READY_RAD, AWAY_RAD, LIMITS[kind.model])


@pytest.fixture
def back(kind: Kind) -> JointPath:
    return move_path(AWAY_RAD, READY_RAD, LIMITS[kind.model])


def test_an_arm_must_be_entered(kind: Kind, there: JointPath) -> None:
    arm = kind.make()
    for use in (arm.state, lambda: arm.execute(there), arm.recover):
        with pytest.raises(DeviceUnavailable):
            use()


def test_an_arm_left_is_unavailable(kind: Kind) -> None:
    arm = kind.make()
    with arm:
        arm.state()
    with pytest.raises(DeviceUnavailable):
        arm.state()


def test_the_state_is_at_rest_and_well(kind: Kind) -> None:
    with kind.make() as arm:
        state = arm.state()
        assert arm.model == kind.model
        assert state.fault is None
        np.testing.assert_allclose(state.q_rad, READY_RAD, atol=kind.rest_rad)
        np.testing.assert_allclose(state.dq_rad_s, 0.0, atol=kind.rest_rad_s)


def test_a_path_is_played_to_its_end(kind: Kind, there: JointPath, back: JointPath) -> None:
    with kind.make() as arm:
        before_s = arm.state().t_s
        played = arm.execute(there)
        assert played.q_commanded_rad.shape == played.q_measured_rad.shape == (len(played.t_s), 7)
        assert played.t_s[0] == 0.0
        assert played.t_start_s >= before_s
        assert 0.0 < played.control_success_rate <= 1.0
        np.testing.assert_allclose(played.q_measured_rad, played.q_commanded_rad, atol=0.02)
        np.testing.assert_allclose(arm.state().q_rad, AWAY_RAD, atol=2e-3)
        assert arm.state().t_s >= played.t_start_s + there.duration_s - 1e-9
        assert arm.execute(back).t_start_s >= played.t_start_s + there.duration_s - 1e-9
        np.testing.assert_allclose(arm.state().q_rad, READY_RAD, atol=2e-3)


def test_a_path_that_breaks_a_limit_is_refused_and_nothing_moves(kind: Kind, there: JointPath) -> None:
    too_fast = JointPath(there.t_s[: len(there.t_s[::4])], there.q_rad[::4])
    with kind.make() as arm:
        before = arm.state()
        with pytest.raises(MotionRefused, match=r"joint \d at t = .* limit"):
            arm.execute(too_fast)
        after = arm.state()
        np.testing.assert_allclose(after.q_rad, before.q_rad, atol=kind.rest_rad)
        assert after.t_s >= before.t_s
        assert after.fault is None


def test_a_path_from_elsewhere_is_refused(kind: Kind, back: JointPath) -> None:
    with kind.make() as arm, pytest.raises(MotionRefused, match="distance from the arm"):
        arm.execute(back)


def test_a_fault_stops_and_needs_recovery_which_never_resumes(kind: Kind, there: JointPath) -> None:
    touching = JointPath(there.t_s, there.q_rad, kind.contact)
    with kind.make_faulty() as arm:
        with pytest.raises(ArmFault):
            arm.execute(touching)
        stopped = arm.state()
        assert stopped.fault
        assert np.abs(stopped.q_rad - READY_RAD).max() > 1e-3
        assert np.abs(stopped.q_rad - AWAY_RAD).max() > 1e-3
        home = move_path(stopped.q_rad, READY_RAD, LIMITS[kind.model])
        with pytest.raises(ArmFault, match="recover"):
            arm.execute(home)
        arm.recover()
        assert arm.state().fault is None
        np.testing.assert_allclose(arm.state().q_rad, stopped.q_rad, atol=kind.rest_rad)
        arm.execute(home)
        np.testing.assert_allclose(arm.state().q_rad, READY_RAD, atol=2e-3)
