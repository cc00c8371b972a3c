"""The arm of a real lab: nothing moves before its model is typed, and a person is led back to an arm that moves."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell
from players import arm_of
from real_lab import (
    READY_RAD,
    ToyPedal,
    quiet,
    said,
    typing,
)
from sdk_fake import FakeSdk

from adaptsim_cli.devices.attended import offer_recovery
from adaptsim_cli.devices.confirmed import ConfirmedArm
from adaptsim_cli.devices.consent import Consent
from adaptsim_cli.errors import StoppedByOperator
from hw.collision import LEVEL
from hw.errors import MotionRefused
from hw.fake import FakeArm, FakeClock, FakeGuardedArm
from hw.types import JointPath

STILL = JointPath(np.linspace(0.0, 0.01, 11), np.tile(READY_RAD, (11, 1)))


def test_the_model_is_typed_once_before_the_first_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    bare, screen = FakeArm(READY_RAD, FakeClock(), cell()), quiet()
    typing(monkeypatch, "", "y", "yes", "Panda")
    with ConfirmedArm(FakeGuardedArm(bare, LEVEL), Consent(screen, "panda at 10.0.0.1", operator="Kim"), None) as arm:
        arm.execute(STILL)
        arm.execute(STILL)
    assert len(bare.executed) == 2
    assert said(screen).count("Type panda to confirm") == 4
    assert "THE REAL ROBOT, panda at 10.0.0.1, is about to move for the first time" in said(screen)


@pytest.mark.parametrize("answers", [("q",), ("yes", "q"), ()])
def test_nothing_moves_unless_it_is_typed(answers: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    bare = FakeArm(READY_RAD, FakeClock(), cell())
    typing(monkeypatch, *answers)
    with (
        ConfirmedArm(FakeGuardedArm(bare, LEVEL), Consent(quiet(), "panda", operator="Kim"), None) as arm,
        pytest.raises(StoppedByOperator),
    ):
        arm.execute(STILL)
    assert bare.executed == []


def test_a_motion_waits_for_the_pedal_and_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    typing(monkeypatch, "panda")
    bare, clock, screen = FakeArm(READY_RAD, FakeClock(), cell()), FakeClock(), quiet()
    pedal = ToyPedal([False, False, False, True]).__enter__()
    with ConfirmedArm(
        FakeGuardedArm(bare, LEVEL),
        Consent(screen, "panda", operator="Kim"),
        pedal,
        now_s=clock.now_s,
        pause=clock.sleep,
    ) as arm:
        arm.execute(STILL)
        assert "Hold the pedal to let the arm move: the pedal is released" in said(screen)
        assert clock.now_s() == pytest.approx(0.04), "two looks"
        pedal.held = [False]
        with pytest.raises(MotionRefused, match="30 s"):
            arm.execute(STILL)
    assert len(bare.executed) == 1


def test_from_a_stop_button_and_a_reflex_a_person_is_led_back_to_an_arm_that_moves() -> None:
    """The stop button, a reflex behind it that needs a joint to be guided first, and then an arm that is Idle."""
    sdk = FakeSdk(k=True)
    sdk.modes.pressed = True
    asked: list[str] = []

    def answer(question: str, presses: object = None) -> str:
        asked.append(question.partition("(nothing moves). ")[2] or question.partition("anything. ")[2])
        if not sdk.modes.pressed:
            return "recover"
        sdk.modes.be("Reflex")
        sdk.modes.by_hand_first = True
        return ""

    screen = quiet()
    screen.ask = answer  # type: ignore[method-assign]
    with arm_of(sdk) as arm:
        offer_recovery(arm, screen)
        assert arm.state().fault is None
    recover = "Type recover to clear it, Enter to leave it, q to stop, ? explains:"
    assert asked == ["Enter when done, q to stop, ? explains:", recover, recover]
    assert not any(name in ("command", "set_load") for name, _ in sdk.calls)


def test_who_leaves_a_pressed_stop_button_stops_the_command() -> None:
    sdk = FakeSdk(k=False)
    sdk.modes.pressed = True
    screen = quiet()
    screen.ask = lambda question, presses=None: "q"  # type: ignore[method-assign]
    with arm_of(sdk, "fr3") as arm, pytest.raises(StoppedByOperator):
        offer_recovery(arm, screen)
