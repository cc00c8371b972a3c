"""A touch is not searched with a dead sense of force: it is refused before the arm moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from guarded_paths import GUARD, Q_AWAY_RAD, Q_TOP_RAD, TOOL, approach, down
from players import arm_of
from sdk_fake import FakeSdk, alive

from hw.contact import TORQUE_NOISE_NM, predicted_force_N
from hw.errors import MotionRefused
from hw.types import ContactWindow, JointPath

PATH = down(0.005, 0.008)
PRESSING = JointPath(
    np.arange(200) / 1000, np.tile(Q_TOP_RAD, (200, 1)), ContactWindow(0.0, 0.199, 0.001, predicted_force_N(GUARD, 0.0))
)
"""A task's motion with a contact window, which stays where it is."""
Feels = Callable[[list[float]], list[float]]


def noise_alone() -> Feels:
    """A dead estimate to which something adds noise."""
    rng = np.random.default_rng(3)
    return lambda q: (0.8 + TORQUE_NOISE_NM * rng.standard_normal(7)).tolist()


def one_joint_dead() -> Feels:
    live = alive()
    return lambda q: [*live(q)[:4], 0.3, *live(q)[5:]]


def commands(sdk: FakeSdk) -> int:
    return sum(name == "command" for name, _ in sdk.calls)


@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize(
    ("feels", "match"),
    [
        (lambda q: [0.0] * 7, r"estimate of external torques is dead: joint 1 stood at 0 Nm over 100 readings"),
        (lambda q: [0.8] * 7, r"dead: joint 1 stood at 0\.8 Nm"),
        (one_joint_dead(), r"dead: joint 5 stood at 0\.3 Nm"),
    ],
)
def test_a_dead_estimate_moves_nothing_not_even_the_first_free_motion(model: str, feels: Feels, match: str) -> None:
    sdk = FakeSdk(k=model == "panda", q_rad=Q_TOP_RAD.tolist(), feels=feels)
    with arm_of(sdk, model, tool=TOOL) as arm:
        with pytest.raises(MotionRefused, match=match):
            arm.execute_until_contact(PATH, GUARD)
        with pytest.raises(MotionRefused, match="dead"):
            arm.execute(JointPath(PATH.t_s[:50], np.tile(Q_TOP_RAD, (50, 1))))
    assert commands(sdk) == 0


@pytest.mark.long
@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_an_estimate_that_dies_later_ends_the_touching(model: str) -> None:
    sdk = FakeSdk(k=model == "panda", q_rad=Q_AWAY_RAD.tolist())
    with arm_of(sdk, model, tool=TOOL) as arm:
        arm.execute(approach())
        arm.execute(PRESSING)
        sdk.feels, before = (lambda q: [0.0] * 7), commands(sdk)
        with pytest.raises(MotionRefused, match=r"dead: joint 1.*Nothing has moved.*Desk"):
            arm.execute_until_contact(PATH, GUARD)
    assert commands(sdk) == before


def test_noise_around_a_constant_is_no_sense_of_force() -> None:
    sdk = FakeSdk(k=True, q_rad=Q_AWAY_RAD.tolist(), feels=noise_alone())
    with arm_of(sdk, tool=TOOL) as arm:
        arm.execute(approach())
        before = commands(sdk)
        with pytest.raises(
            MotionRefused, match=r"does not follow the arm: in two postures 0\.10 rad apart it is the same"
        ):
            arm.execute_until_contact(PATH, GUARD)
    assert commands(sdk) == before


def test_one_posture_proves_nothing() -> None:
    sdk = FakeSdk(k=True, q_rad=Q_TOP_RAD.tolist())
    with arm_of(sdk, tool=TOOL) as arm, pytest.raises(MotionRefused, match=r"one posture only.*Guide the arm by hand"):
        arm.execute_until_contact(PATH, GUARD)
    assert commands(sdk) == 0


@pytest.mark.long
def test_the_contact_window_of_a_task_motion_needs_it_too() -> None:
    sdk = FakeSdk(k=True, q_rad=Q_AWAY_RAD.tolist())
    with arm_of(sdk, tool=TOOL) as arm:
        arm.execute(approach())
        arm.execute(PRESSING)
        sdk.feels, before = (lambda q: [0.8] * 7), commands(sdk)
        with pytest.raises(MotionRefused, match="dead"):
            arm.execute(PRESSING)
    assert commands(sdk) == before


def test_what_leans_on_the_arm_is_not_tared_away() -> None:
    """Each touch weighs anew."""
    sdk = FakeSdk(k=True, q_rad=Q_AWAY_RAD.tolist())
    with arm_of(sdk, tool=TOOL) as arm:
        arm.execute(approach())
        sdk.feels = alive(lambda q: np.array([0.0, 12.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        with pytest.raises(MotionRefused, match=r"kg more or less than the declared"):
            arm.execute_until_contact(PATH, GUARD)
