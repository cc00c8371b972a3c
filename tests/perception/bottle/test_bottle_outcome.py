"""The true outcome of a bottle in films of drawn worlds."""

from __future__ import annotations

import numpy as np
import pytest
from sensing.filming import bottle_outcome

from hw.types import Array
from perception.types import Outcome

INSIDE_M, OUTSIDE_M = 0.7, 1.3


def poses(*steps: tuple[float, float]) -> Array:
    """(N, 4, 4) of (x in m, lean in degrees)."""
    X_BO = np.tile(np.eye(4), (len(steps), 1, 1))
    for X, (x_m, lean_deg) in zip(X_BO, steps, strict=True):
        c, s = np.cos(np.deg2rad(lean_deg)), np.sin(np.deg2rad(lean_deg))
        X[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        X[0, 3] = x_m
    return X_BO


@pytest.mark.parametrize(
    ("steps", "outcome"),
    [
        (((INSIDE_M, 0), (INSIDE_M, 10)), Outcome.UPRIGHT),
        (((INSIDE_M, 0), (INSIDE_M, 60), (OUTSIDE_M, 90)), Outcome.TIPPED),
        (((INSIDE_M, 0), (OUTSIDE_M, 0), (OUTSIDE_M, 90)), Outcome.LOST),
        (((INSIDE_M, 0), (OUTSIDE_M, 0)), Outcome.LOST),
    ],
)
def test_a_bottle_that_falls_after_it_has_left_the_searched_area_is_lost(
    steps: tuple[tuple[float, float], ...], outcome: Outcome
) -> None:
    assert bottle_outcome(poses(*steps)) is outcome
