"""The pedal answers questions: what counts as a press, and that the press that answered starts no motion."""

from __future__ import annotations

import os
import pty
import threading
import time
from collections.abc import Iterator

import pytest
from cells import cell
from real_lab import READY_RAD, ToyPedal, quiet, said

from adaptsim_cli.devices import confirmed
from adaptsim_cli.devices.confirmed import ConfirmedArm
from adaptsim_cli.devices.consent import Consent
from adaptsim_cli.screen.keys import PAUSE_S, SHORT_S, Key, Presses, enter, stop
from hw.errors import MotionRefused
from hw.fake import FakeArm, FakeClock
from hw.serial.pedal_protocol import PERIOD_S, PedalState, line_for

LOOK_S = 0.02


def counted(*looks: tuple[bool | None, float]) -> int:
    """What so many seconds of each (down, seconds) in turn give at their end."""
    seen, t_s = Presses(), 0.0
    for down, lasts_s in looks:
        for _ in range(round(lasts_s / LOOK_S)):
            seen, t_s = seen.after(down, t_s), t_s + LOOK_S
    return seen.count(t_s)


UP, LATER = (False, 0.2), (False, PAUSE_S + 0.1)


@pytest.mark.parametrize(
    ("looks", "count"),
    [
        ((UP, (True, 0.2), LATER), 1),
        ((UP, (True, 0.2), UP, (True, 0.2), UP), 2),
        ((UP, (True, 0.2), UP), 0),  # a second press may still come
        ((UP, (True, 0.2)), 0),
        ((UP, (True, SHORT_S + 0.1), LATER), 0),  # held
        ((UP, (True, 0.2), UP, (True, SHORT_S + 0.1), LATER), 0),  # the second one is held: that is no answer
        (((True, 0.2), LATER), 0),  # it was down when the question came
        ((UP, (True, 0.2), (None, 0.1), LATER), 0),  # its cable was lost while it was down
        ((UP, (None, 0.1), (True, 0.2), LATER), 0),
        ((LATER, LATER), 0),
    ],
)
def test_a_press_counts_from_its_beginning_to_its_end(looks, count):
    assert counted(*looks) == count


def test_a_silent_or_restarted_box_is_neither_up_nor_down():
    state = PedalState()
    for counter, pressed in enumerate((False, False, True)):
        state = state.feed(line_for(counter, pressed), counter * PERIOD_S)
    assert not state.up(2 * PERIOD_S) and state.enabled(2 * PERIOD_S)
    assert not state.up(1.0) and not state.enabled(1.0)
    restarted = state.feed(line_for(0, True), 3 * PERIOD_S)
    assert not restarted.up(3 * PERIOD_S) and not restarted.enabled(3 * PERIOD_S)
    assert restarted.feed(line_for(1, False), 4 * PERIOD_S).up(4 * PERIOD_S)


class Foot(threading.Thread):
    """Presses `pedal` for each (down, seconds) in turn."""

    def __init__(self, pedal: ToyPedal, *steps: tuple[bool, float]) -> None:
        super().__init__(daemon=True)
        self.pedal, self.steps = pedal, steps
        self.start()

    def run(self) -> None:
        for down, lasts_s in self.steps:
            self.pedal.held = [down]
            time.sleep(lasts_s)


@pytest.fixture
def keyboard(monkeypatch) -> Iterator[int]:
    ours, theirs = pty.openpty()
    stdin = os.fdopen(theirs, encoding="utf-8")
    monkeypatch.setattr("sys.stdin", stdin)
    yield ours
    stdin.close()
    os.close(ours)


REVIEW = (enter("to accept", "It counts."), Key("r", "to reject it", "It is made again."), stop("It ends."))


@pytest.mark.parametrize(
    ("keys", "steps", "answer"),
    [
        (REVIEW, ((False, 0.2), (True, 0.2), (False, 1.0)), ""),
        (REVIEW, ((False, 0.2), (True, 0.2), (False, 0.2), (True, 0.2), (False, 1.0)), "r"),
    ],
)
def test_one_press_is_enter_and_two_are_r(keyboard, keys, steps, answer):
    screen = quiet()
    with ToyPedal([False]) as pedal:
        screen.hear(pedal)
        foot = Foot(pedal, *steps)
        assert screen.choose("Is this what you saw?", *keys) == answer
        foot.join()


def test_what_has_to_be_typed_is_typed(keyboard):
    """No press confirms the first motion; two ask the question again."""
    screen = quiet()
    with ToyPedal([False]) as pedal:
        screen.hear(pedal)
        foot = Foot(
            pedal, (False, 0.2), (True, 0.2), (False, 0.8), (True, 0.2), (False, 0.2), (True, 0.2), (False, 0.3)
        )
        typist = threading.Timer(3.0, os.write, (keyboard, b"fr3\n"))
        typist.start()
        assert screen.choose("Have you checked all of this?", Key("fr3", "to confirm", ""), stop("")) == "fr3"
        foot.join()
        typist.join()
    assert said(screen).count("Have you checked all of this?") == 2


def test_the_press_that_answered_starts_no_motion(keyboard, monkeypatch):
    """After the answer the arm waits for the pedal, and refuses when nobody presses it again."""
    monkeypatch.setattr(confirmed, "PATIENCE_S", 0.3)
    screen = quiet()
    with ToyPedal([False]) as pedal:
        screen.hear(pedal)
        foot = Foot(pedal, (False, 0.2), (True, 0.2), (False, 0.1))
        consent = Consent(screen, "the arm", operator="Kim", pedal=True, each="motion")
        consent.given = "2026-01-01T00:00:00+00:00"
        arm = ConfirmedArm(FakeArm(READY_RAD, FakeClock(), cell("fr3")), consent, pedal)
        with pytest.raises(MotionRefused, match="the pedal was not held"):
            arm.await_enabled()
        foot.join()


def test_an_enter_typed_ahead_starts_nothing(monkeypatch):
    ours, theirs = pty.openpty()
    screen = quiet()
    os.write(ours, b"\n\n\n")
    threading.Timer(0.3, os.write, (ours, b"q\n")).start()
    with os.fdopen(theirs, encoding="utf-8") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        assert screen.choose("Is the work area clear?", enter("to start", "It moves."), stop("It ends.")) == "q"
    os.close(ours)
    assert said(screen).count("Is the work area clear?") == 1
