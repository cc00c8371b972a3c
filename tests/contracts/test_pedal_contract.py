"""What every enabling pedal does: on a pseudo-terminal, the fake of other tests, and a real one."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
from clocks import FakeClock
from real_lab import ToyPedal
from serial_lines import boxed, plugged_in, until

from hw.ports import Pedal
from hw.serial import enable_pedal
from hw.serial.enable_pedal import EnablePedal


@dataclass(frozen=True)
class Foot:
    """A pedal that nobody stands on yet, and the foot that does."""

    pedal: Pedal
    press: Callable[[], None]
    release: Callable[[], None]
    settled: Callable[[Callable[[], bool]], None]  # waits until it holds, where the pedal hears with a delay


def _at_once(condition: Callable[[], bool]) -> None:
    assert condition()


@contextmanager
def on_a_line(monkeypatch: pytest.MonkeyPatch) -> Iterator[Foot]:
    """Its clock stands still, so that a busy machine never counts as a silent pedal."""
    monkeypatch.setattr(enable_pedal.EnablePedal.__init__, "__defaults__", (FakeClock(100.0).now_s,))
    monkeypatch.setattr(enable_pedal, "_GREETING_S", 10.0)
    with plugged_in() as line, boxed(line) as box:

        def step(pressed: bool) -> None:
            box.pressed = pressed

        yield Foot(EnablePedal(line.port), lambda: step(True), lambda: step(False), until)


@contextmanager
def toy(_: pytest.MonkeyPatch) -> Iterator[Foot]:
    pedal = ToyPedal(held=[False])

    def step(pressed: bool) -> None:
        pedal.held = [pressed]

    yield Foot(pedal, lambda: step(True), lambda: step(False), _at_once)


@contextmanager
def real(_: pytest.MonkeyPatch) -> Iterator[Foot]:
    """The pedal at ADAPTSIM_TEST_PEDAL, which nobody touches."""
    port = os.environ.get("ADAPTSIM_TEST_PEDAL")
    if not port:
        pytest.fail("say where the pedal is: ADAPTSIM_TEST_PEDAL=/dev/ttyACM0")

    def nobody() -> None:
        pytest.skip("nobody presses a real pedal for a test")

    yield Foot(EnablePedal(port), nobody, nobody, until)


KINDS = {"serial": on_a_line, "toy": toy}


@pytest.fixture(params=[*KINDS, pytest.param("real", marks=pytest.mark.hardware)])
def foot(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Foot]:
    with KINDS.get(request.param, real)(monkeypatch) as made:
        yield made


def test_it_must_be_entered(foot: Foot) -> None:
    assert not foot.pedal.enabled()
    assert foot.pedal.why_not()


def test_released_it_says_so(foot: Foot) -> None:
    with foot.pedal as pedal:
        assert pedal is foot.pedal
        foot.settled(lambda: "released" in pedal.why_not())
        assert not pedal.enabled()


def test_it_enables_while_it_is_held(foot: Foot) -> None:
    with foot.pedal as pedal:
        for _ in range(3):
            foot.press()
            foot.settled(pedal.enabled)
            foot.release()
            foot.settled(lambda: not pedal.enabled())
            assert "released" in pedal.why_not()


def test_left_while_held_it_enables_nothing(foot: Foot) -> None:
    with foot.pedal as pedal:
        foot.press()
        foot.settled(pedal.enabled)
    assert not pedal.enabled()
    assert pedal.why_not()
