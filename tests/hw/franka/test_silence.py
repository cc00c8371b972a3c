"""Silence of pedal and program at their real 60 ms, and a computer that sleeps, in the real player (`silence`).

They are measured in real time, so they are slow tests: beside other tests a computer is late by itself.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from silence import ASLEEP_S, FAULTS, NOISE_S, Happened, Noise, quietest

from hw.braking import STOP_S
from hw.watchdog import SILENCE_S, WORD_EVERY_S

LATE_S = 0.021 + WORD_EVERY_S + NOISE_S
"""Until the next moment at which a stop may begin, and of the last word before the silence."""
LAG_S = 0.05
"""Of franky-sim's controller behind its commands."""


@pytest.fixture(scope="module")
def noise() -> Iterator[Noise]:
    with Noise() as made:
        yield made


def found(name: str, noise: Noise) -> Happened:
    one = quietest(noise, FAULTS[name], 1.0)
    if one.noise_s > NOISE_S:
        pytest.skip(f"this computer held every process up for {1e3 * one.noise_s:.0f} ms: try one with more cores")
    assert isinstance(one, Happened), one.said
    assert one.said["error"]
    assert not one.said["enabled"], "a new press has to be seen"
    return one


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("name", "why"), [("pedal", "pedal"), ("program", "silence")])
def test_a_silence_of_60_ms_brakes_the_arm(noise: Noise, name: str, why: str) -> None:
    one = found(name, noise)
    assert one.said["why"] == why
    assert SILENCE_S - WORD_EVERY_S - NOISE_S <= one.braking_after_s <= SILENCE_S + LATE_S
    assert one.still_after_s <= SILENCE_S + STOP_S + LAG_S


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_computer_that_slept_brakes_at_once_and_needs_a_new_press(noise: Noise) -> None:
    """The arm waited, and the pedal was held all the time."""
    one = found("sleep", noise)
    assert one.said["why"] in ("silence", "pedal")
    assert one.braking_after_s - ASLEEP_S <= LATE_S
