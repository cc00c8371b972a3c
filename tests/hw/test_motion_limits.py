"""Torques, contact torques, travel of the flange, and what lies between two samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cells import READY, cell, find, joint, move

from hw.capsules import Capsule
from hw.collision import BARE_HAND, HAND_MASS, KeepOut, Tool, box_clearance, self_clearance
from hw.dynamics import torque_Nm
from hw.errors import MotionRefused
from hw.joint_limits import derivatives
from hw.kinematics import FLANGE, forward, link_poses
from hw.mass import Mass
from hw.motion_limits import FLANGE as FLANGE_LIMITS
from hw.motion_limits import RATED_NM, TORQUE_SHARE
from hw.types import ContactWindow, JointPath
from hw.workcell import STOPS_AT_NM

STRETCHED = np.array([0.0, 1.1, 0.0, -0.5, 0.0, 1.65, 0.8])


def loaded(kg: float, at_m: tuple[float, float, float] = (0.0, 0.0, 0.1)) -> Tool:
    load = Mass(kg, np.array(at_m), 0.002 * np.eye(3))
    return replace(BARE_HAND, name=f"{kg:g} kg", mass=HAND_MASS + load)


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_what_an_empty_hand_does_a_loaded_one_may_not(model: str) -> None:
    """A stretched arm lifts its load: joint 2 carries it all."""
    lift = move(joint(2, -0.25), 0.6, start_rad=STRETCHED)
    report = cell(model).require(lift)
    assert report.ok
    with pytest.raises(MotionRefused, match=r"torque of joint 2 at t = 0\.\d+ s is .* Nm, limit 78\.3 Nm"):
        cell(model, loaded(3.0)).require(lift)
    dq, ddq, _ = derivatives(lift.q_rad)
    q = np.concatenate([lift.q_rad, np.repeat(lift.q_rad[-1:], 3, axis=0)])
    worst = find(lift, "torque", cell(model, loaded(3.0)))
    assert abs(torque_Nm(model, q, dq, ddq, loaded(3.0).mass)[:, 1]).max() == pytest.approx(abs(worst.value))


def test_a_load_far_out_is_too_much_for_the_wrist() -> None:
    still = move(joint(1, 0.1), 1.0)
    assert cell("fr3", loaded(1.0)).check(still).ok
    far = find(still, "torque", cell("fr3", loaded(3.0, (0.45, 0.0, 0.0))))
    assert far.where in ("joint 5", "joint 6", "joint 7")
    assert far.limit == pytest.approx(TORQUE_SHARE * RATED_NM[6])
    assert far.ratio > 1.0


def test_the_torque_rate_is_that_of_the_samples() -> None:
    """Joints 1 to 3 shake at 50 Hz, each within its own limits; together they ask for more than 1000 Nm/s."""
    t_s = np.arange(401) / 1000
    envelope = np.sin(np.pi * t_s / t_s[-1]) ** 4
    shake = (7.0 / (100 * np.pi) ** 2 * envelope * np.sin(100 * np.pi * t_s))[:, None]
    one = JointPath(t_s, READY + shake * np.array([1.0, 1.0, 1.0, 0, 0, 0, 0]))
    found = find(one, "torque rate", cell())
    assert found.limit == 1000.0
    assert found.ratio > 1.0
    assert all(
        c.ratio <= 1.0
        for c in cell().check(one).checks
        if c.where.startswith("joint") and c is not found and c.quantity not in ("torque rate", "torque")
    )


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_the_flange_keeps_to_the_makers_cartesian_limits(model: str) -> None:
    """Joints 1 and 7 turn the same way, each within its limits; the wrist turns with the speed of both."""
    turning = move(joint(1, 1.2) - joint(7, 1.2), 1.4)
    found = find(turning, "turning speed", cell(model))
    assert (found.where, found.limit) == ("the flange", FLANGE_LIMITS[model].rad_s)
    R = forward(turning.q_rad)[:, :3, :3]
    cosine = (np.einsum("nij,nij->n", R[1:], R[:-1]) - 1.0) / 2.0
    assert found.value == pytest.approx(1e3 * np.arccos(np.clip(cosine, -1.0, 1.0)).max(), rel=2e-3)
    assert found.ratio > 1.0


def test_every_stop_keeps_the_torques_too() -> None:
    """A path within its limits whose stops are not: the load swings, and a stop asks for more than going on."""
    limits = cell("panda", loaded(1.0)).motion
    q = np.linspace(0.0, 1.0, 41)[:, None, None] * joint(2, -0.03) + STRETCHED
    still = limits.ratio(q, np.zeros_like(q), np.zeros_like(q), 0.004)
    lifted = limits.ratio(q, np.zeros_like(q), np.zeros_like(q) + joint(2, -7.5), 0.004)
    assert still.shape == (1,)
    assert still[0] < 1.0 < lifted[0]


def test_what_a_contact_does_to_the_wrist_stays_below_where_the_arm_stops() -> None:
    tip = np.array([0.3, 0.0, 0.1])
    tool = Tool("lever", HAND_MASS, (), tip[None])
    over = replace(move(joint(1, 0.05), 1.0), contact=ContactWindow(0.2, 0.8, 0.001, 40.0))
    found = find(over, "predicted contact torque", cell(tool=tool))
    assert found.limit <= 0.8 * max(STOPS_AT_NM)
    assert found.ratio > 1.0
    assert find(over, "predicted contact torque", cell(tool=tool, stops_at_Nm=np.full(7, 80.0))).ratio < found.ratio


def test_a_thin_rod_that_passes_between_two_samples_is_found() -> None:
    """Its tip passes 9.6 mm over a wire. 10 ms before and after it is farther than the 10 mm that are asked for."""
    rod = Tool("rod", HAND_MASS, (Capsule("rod", FLANGE, np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, 0.2]), 0.001),))
    swing = move(joint(1, 1.0), 0.9)
    X = forward(swing.q_rad)
    tip_m = X[:, :3, :3] @ np.array([0.0, 0.0, 0.2]) + X[:, :3, 3]
    under = tip_m[445] - np.array([0.0, 0.0, 0.001 + 0.0096])
    wire = KeepOut("wire", under - np.array([1e-5, 1e-5, 0.2]), under + np.array([1e-5, 1e-5, 0.0]))
    clearances, names = box_clearance(link_poses(swing.q_rad[::10]), rod, wire)
    assert clearances[:, names.index("rod and wire")].min() > 0.01
    found = find(swing, "keep-out", cell(tool=rod, keep_out=(wire,)))
    assert found.value == pytest.approx(0.0096, abs=5e-4)
    assert found.ratio > 1.0
    below = KeepOut("wire", wire.low_m, wire.high_m - np.array([0.0, 0.0, 0.0012]))
    assert find(swing, "keep-out", cell(tool=rod, keep_out=(below,))).ratio < 1.0


def test_bounds_between_samples_are_never_above_what_is_there() -> None:
    """Against the same path looked at a hundred times as finely."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        start_rad = READY + rng.uniform(-0.2, 0.2, 7)
        one = move(rng.uniform(-0.5, 0.5, 7), 0.8, start_rad=start_rad)
        said = find(one, "self-collision", cell()).value
        steps = np.arange(0.0, len(one.t_s) - 1.0, 0.1)
        fine = np.column_stack([np.interp(steps, np.arange(len(one.t_s)), q) for q in one.q_rad.T])
        assert said <= float(self_clearance(link_poses(fine), BARE_HAND)[0].min()) + 1e-9
