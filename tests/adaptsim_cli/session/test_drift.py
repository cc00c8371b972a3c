"""A camera that sees otherwise than in the first trial is said, with the numbers."""

from __future__ import annotations

import numpy as np
import pytest

from adaptsim_cli.session.drift import brightness, drift
from adaptsim_cli.session.records import RigFacts


def facts(grey: float | None = 84.0, exposure_us: int = 8330, told: bool = True) -> RigFacts:
    film = {"exposure_us_and_white_balance_K": [[exposure_us, 4500]]} if told else None
    return RigFacts(brightness=grey, camera={"serial": "1", "recording": film})


@pytest.mark.parametrize("now", [facts(), facts(90.0), facts(None), facts(told=False), RigFacts()])
def test_what_stays_is_not_said(now: RigFacts) -> None:
    assert drift(facts(), now) is None
    assert drift(RigFacts(), now) is None


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (facts(65.0), "23% darker than in the first trial (84 then, 65 of 255 now; at most 15%)"),
        (facts(120.0), "43% brighter"),
        (facts(exposure_us=2500), "are 2500 µs and 4500 K, 8330 µs and 4500 K in the first trial"),
    ],
)
def test_what_drifts_is_said(now: RigFacts, said: str) -> None:
    assert said in str(drift(facts(), now))


def test_brightness_is_the_median_grey() -> None:
    picture = np.full((4, 6, 3), 40, np.uint8)
    picture[0, 0] = 255
    assert brightness(picture) == 40.0
