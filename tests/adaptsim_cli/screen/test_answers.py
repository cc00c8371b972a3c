"""Which input answers a question: a line typed at the keyboard after it was asked, and nothing else."""

from __future__ import annotations

import os
import pty
import threading
from collections.abc import Iterator

import pytest
from real_lab import ToyDevices, ToyPedal, calibrated, quiet, said, write_rig

from adaptsim_cli import config
from adaptsim_cli.screen.keys import enter, stop
from adaptsim_cli.session.opening import open_trials
from sim.tasks import get_task


@pytest.fixture
def keyboard(monkeypatch) -> Iterator[int]:
    ours, theirs = pty.openpty()
    stdin = os.fdopen(theirs, encoding="utf-8")
    monkeypatch.setattr("sys.stdin", stdin)
    yield ours
    stdin.close()
    os.close(ours)


class TappedPedal(ToyPedal):
    """A foot taps it at every look."""

    looks = 0

    def enabled(self) -> bool:
        self.looks += 1
        return self.connected and self.looks % 20 > 10

    pressed = enabled


def test_no_foot_answers_a_question(keyboard, place, kim):
    """A real lab with its pedal: while a question waits, nobody even looks at the pedal."""
    write_rig(place)
    there = config.load({"hw": "panda", "task": "scooping"})
    calibrated(there)
    screen, pedal = quiet(), TappedPedal()
    devices = ToyDevices(pedal=pedal)
    with open_trials(there.config, there.places, get_task("scooping"), devices.drivers(), screen=screen):
        threading.Timer(0.5, os.write, (keyboard, b"q\n")).start()
        assert screen.choose("Is it clear?", enter("to go on", "It goes on."), stop("It ends.")) == "q"
    assert not pedal.connected and pedal.looks == 0
    assert "pedal answers" not in said(screen)


def test_an_enter_typed_ahead_starts_nothing(keyboard):
    screen = quiet()
    os.write(keyboard, b"\n\n\n")
    threading.Timer(0.3, os.write, (keyboard, b"q\n")).start()
    assert screen.choose("Is the work area clear?", enter("to start", "It moves."), stop("It ends.")) == "q"
    assert said(screen).count("Is the work area clear?") == 1
