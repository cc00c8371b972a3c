"""The arm of a real lab: nothing moves before its model is typed, a person is led back to an arm that moves, and a
motion that did not come to its end is remembered."""

from __future__ import annotations

from dataclasses import replace

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
    waiver,
)
from sdk_fake import FakeSdk

from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.known_arm import KnownArm
from adaptsim_cli.bench.devices.recovery import offer_recovery
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from hw.errors import ArmFault, MotionRefused
from hw.fake import FakeArm, FakeClock
from hw.types import Execution, JointPath

STILL = JointPath(np.linspace(0.0, 0.01, 11), np.tile(READY_RAD, (11, 1)))


def test_the_model_is_typed_once_before_the_first_motion(monkeypatch):
    bare, screen = FakeArm(READY_RAD, FakeClock(), cell()), quiet()
    typing(monkeypatch, "", "y", "yes", "Panda")
    with ConfirmedArm(bare, Consent(screen, "panda at 10.0.0.1", operator="Kim"), None) as arm:
        arm.execute(STILL)
        arm.execute(STILL)
    assert len(bare.executed) == 2
    assert said(screen).count("Type panda to confirm") == 4
    assert "THE REAL ROBOT, panda at 10.0.0.1, is about to move for the first time" in said(screen)


@pytest.mark.parametrize("answers", [("q",), ("yes", "q"), ()])
def test_nothing_moves_unless_it_is_typed(answers, monkeypatch):
    bare = FakeArm(READY_RAD, FakeClock(), cell())
    typing(monkeypatch, *answers)
    with (
        ConfirmedArm(bare, Consent(quiet(), "panda", operator="Kim"), None) as arm,
        pytest.raises(StoppedByOperator),
    ):
        arm.execute(STILL)
    assert bare.executed == []


def test_a_motion_waits_for_the_pedal_and_gives_up(monkeypatch):
    typing(monkeypatch, "panda")
    bare, clock, screen = FakeArm(READY_RAD, FakeClock(), cell()), FakeClock(), quiet()
    pedal = ToyPedal([False, False, False, True]).__enter__()
    consent = Consent(screen, "panda", operator="Kim")
    with ConfirmedArm(bare, consent, pedal, now_s=clock.now_s, pause=clock.sleep) as arm:
        arm.execute(STILL)
        assert "Hold the pedal to let the arm move: the pedal is released" in said(screen)
        assert clock.now_s() == pytest.approx(0.04), "two looks"
        pedal.held = [False]
        with pytest.raises(MotionRefused, match="30 s"):
            arm.execute(STILL)
    assert len(bare.executed) == 1


def test_from_a_stop_button_and_a_reflex_a_person_is_led_back_to_an_arm_that_moves():
    """The stop button, a reflex behind it that needs a joint to be guided first, and then an arm that is Idle."""
    sdk = FakeSdk(k=True)
    sdk.modes.pressed = True
    asked: list[str] = []

    def answer(question: str) -> str:
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


def test_who_leaves_a_pressed_stop_button_stops_the_command():
    sdk = FakeSdk(k=False)
    sdk.modes.pressed = True
    screen = quiet()
    screen.ask = lambda question: "q"  # type: ignore[method-assign]
    with arm_of(sdk, "fr3") as arm, pytest.raises(StoppedByOperator):
        offer_recovery(arm, screen)


def remembering(screen: Screen, known: KnownArm) -> Consent:
    return Consent(
        screen, "panda", operator="Kim", known_arm=known, waivers=(waiver("stop_button"), waiver("slow_start"))
    )


def test_every_motion_says_how_many_commands_came_in_time(monkeypatch):
    typing(monkeypatch, "panda")
    screen, rates = quiet(), [0.9995, 0.9312]

    class Late(FakeArm):
        notes = ("the processor may fall asleep",)

        def execute(self, path: JointPath) -> Execution:
            return replace(super().execute(path), control_success_rate=rates.pop(0))

    bare = Late(READY_RAD, FakeClock(), cell())
    with ConfirmedArm(bare, Consent(screen, "panda", operator="Kim"), None) as arm:
        assert "the processor may fall asleep" in said(screen)
        arm.execute(STILL)
        assert "100.0 % of the commands reached the arm in time" in said(screen)
        assert "Only" not in said(screen)
        arm.execute(STILL)
    assert "Only 93.1 % of the commands reached the arm in time (at least 95 %)" in said(screen)
    assert "adaptsim doctor --hw panda" in said(screen)


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (ArmFault("panda stopped 0.4 s into the path: joint_reflex"), "joint_reflex"),
        (KeyboardInterrupt(), "KeyboardInterrupt"),
        (None, "the program ended during the motion: it was killed"),
    ],
)
def test_a_stop_is_never_forgotten(error, why, tmp_path, monkeypatch):
    known = KnownArm(tmp_path / "arms" / "panda-lab")

    class Stopping(FakeArm):
        wrong: BaseException | None = error

        def execute(self, path: JointPath) -> Execution:
            if self.wrong is not None:
                raise self.wrong
            return super().execute(path)

    def arm(screen: Screen) -> ConfirmedArm:
        typing(monkeypatch, "panda")
        bare = Stopping(READY_RAD, FakeClock(), cell())
        return ConfirmedArm(bare, remembering(screen, known), None)

    if error is None:  # killed: nobody came to take the note away
        moving = known.moving()
        moving.__enter__()
    else:
        first = quiet()
        with arm(first) as moved, pytest.raises(type(error)):
            moved.execute(STILL)
        assert "last motion" not in said(first)
    screen = quiet()
    Stopping.wrong = None
    with arm(screen) as moved:
        moved.execute(STILL)
    assert why in said(screen)
    assert said(screen).index("Check before") < said(screen).index("Type panda to confirm")
    assert known.unended() is None, "a motion that ended well takes the note away"


def test_a_refused_motion_is_no_stop(tmp_path, monkeypatch):
    typing(monkeypatch, "panda")
    known = KnownArm(tmp_path)
    far = JointPath(STILL.t_s, STILL.q_rad + 0.5)
    bare = FakeArm(READY_RAD, FakeClock(), cell())
    with (
        ConfirmedArm(bare, remembering(quiet(), known), None) as arm,
        pytest.raises(MotionRefused),
    ):
        arm.execute(far)
    assert known.unended() is None


def test_a_damaged_note_of_the_last_motion_counts_as_a_stop(tmp_path):
    (tmp_path / "last-motion.json").write_text("{")
    assert KnownArm(tmp_path).unended() is not None
