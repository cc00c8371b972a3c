"""Nothing presses on a table with a dead sense of force: the motion is refused before the arm moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from fingertip_paths import FORCE_N, Q_AWAY_RAD, Q_TOP_RAD, TOOL, approach
from players import arm_of
from sdk_fake import FakeSdk, alive
from torque_errors import TORQUE_NOISE_NM

from hw.errors import MotionRefused
from hw.types import ContactWindow, JointPath

PRESSING = JointPath(np.arange(200) / 1000, np.tile(Q_TOP_RAD, (200, 1)), ContactWindow(0.0, 0.199, 0.001, FORCE_N))
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
            arm.execute(PRESSING)
        with pytest.raises(MotionRefused, match="dead"):
            arm.execute(JointPath(PRESSING.t_s[:50], PRESSING.q_rad[:50]))
    assert commands(sdk) == 0


def test_noise_around_a_constant_is_no_sense_of_force() -> None:
    sdk = FakeSdk(k=True, q_rad=Q_AWAY_RAD.tolist(), feels=noise_alone())
    with arm_of(sdk, tool=TOOL) as arm:
        arm.execute(approach())
        before = commands(sdk)
        with pytest.raises(
            MotionRefused, match=r"does not follow the arm: in two postures 0\.10 rad apart it is the same"
        ):
            arm.execute(PRESSING)
    assert commands(sdk) == before


def test_one_posture_proves_nothing() -> None:
    sdk = FakeSdk(k=True, q_rad=Q_TOP_RAD.tolist())
    with arm_of(sdk, tool=TOOL) as arm, pytest.raises(MotionRefused, match=r"one posture only.*Guide the arm by hand"):
        arm.execute(PRESSING)
    assert commands(sdk) == 0


@pytest.mark.long
@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_an_estimate_that_dies_later_ends_the_contacts(model: str) -> None:
    sdk = FakeSdk(k=model == "panda", q_rad=Q_AWAY_RAD.tolist())
    with arm_of(sdk, model, tool=TOOL) as arm:
        arm.execute(approach())
        arm.execute(PRESSING)
        sdk.feels, before = (lambda q: [0.8] * 7), commands(sdk)
        with pytest.raises(MotionRefused, match=r"dead: joint 1.*Nothing has moved.*Desk"):
            arm.execute(PRESSING)
    assert commands(sdk) == before
