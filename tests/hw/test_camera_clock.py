"""The device's clock against the host's."""

from __future__ import annotations

import numpy as np
import pytest

from hw.camera.grabber import LEAST_PAIRS, DeviceClock, gaps
from hw.errors import CameraError


@pytest.mark.parametrize("seed", range(5))
def test_late_arrivals_and_a_drifting_quartz_leave_less_than_a_millisecond(seed: int) -> None:
    rng = np.random.default_rng(seed)
    clock, offset_s, ppm = DeviceClock(delay_s=0.030), 1234.5, rng.choice([-50.0, 50.0])
    for device_s in np.arange(0.0, 120.0, 1 / 30):
        host_s = offset_s + device_s * (1 + 1e-6 * ppm)
        clock.add(float(device_s), float(host_s + 0.030 + rng.exponential(0.004) + (rng.random() < 0.05) * 0.2))
    found = clock.map()
    assert found.host_s(120.0) == pytest.approx(offset_s + 120.0 * (1 + 1e-6 * ppm), abs=1.1e-3)
    assert 0.002 < found.spread_s < 0.006
    assert found.pairs == pytest.approx(600, abs=2)  # of the window, not of all time


def test_a_device_that_starts_anew_is_learned_anew() -> None:
    clock = DeviceClock()
    for i in range(100):
        clock.add(500.0 + i / 30, 900.0 + i / 30)
    clock.add(0.1, 950.0)
    assert clock.map().host_s(0.1) == pytest.approx(950.0)
    assert not clock.is_settled
    for i in range(LEAST_PAIRS):
        clock.add(0.2 + i / 30, 950.1 + i / 30)
    assert clock.is_settled


@pytest.mark.parametrize("skip_s", [0.05, 0.3, 120.0, 1.7e9, -0.05, -120.0])
def test_a_device_whose_clock_is_set_while_it_runs_is_noticed(skip_s: float) -> None:
    clock = DeviceClock(delay_s=0.030)
    for i in range(60):
        clock.add(500.0 + i / 30 + skip_s * (i >= 40), 900.03 + i / 30 + 0.01 * (i % 3))
    assert clock.jumps == 1
    assert clock.map().host_s(500.0 + skip_s) == pytest.approx(900.0, abs=1e-3)


def test_nothing_is_known_before_the_first_image() -> None:
    with pytest.raises(CameraError, match="first image"):
        DeviceClock().map()
    with pytest.raises(ValueError, match="0 or more"):
        DeviceClock(delay_s=-1.0)


@pytest.mark.parametrize(
    ("present", "missing", "gap"),
    [
        (range(1, 30), 0, 1),
        ([*range(1, 10), *range(12, 30)], 2, 3),
        (range(5, 30), 4, 5),
        (range(1, 26), 4, 5),
        ([], 30, 30),
    ],
)
def test_gaps_inside_and_at_the_ends(present: list[int], missing: int, gap: int) -> None:
    found, gap_s = gaps([i / 30 for i in present], 0.0, 1.0, 30.0)
    assert (found, gap_s) == (missing, pytest.approx(gap / 30))


@pytest.mark.parametrize("stands", [True, False], ids=["the same stamp is repeated", "pictures are missing"])
def test_a_device_whose_clock_pauses_is_noticed(stands: bool) -> None:
    clock = DeviceClock(delay_s=0.030)
    for i in range(80):
        paused_s = min(max(i / 30 - 1.5, 0.0), 0.4)
        if stands or not 0.0 < paused_s < 0.4:
            clock.add(500.0 + i / 30 - paused_s, 900.03 + i / 30)
    assert clock.jumps >= 1
    assert clock.map().host_s(500.0 + 79 / 30 - 0.4) == pytest.approx(900.0 + 79 / 30, abs=1e-3)


def test_seven_pictures_that_come_late_are_no_pause() -> None:
    clock = DeviceClock()
    for i in range(80):
        clock.add(500.0 + i / 30, 900.0 + i / 30 + 0.2 * (40 <= i < 47))
    assert clock.jumps == 0
