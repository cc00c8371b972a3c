"""One good calibration, which most checks begin from."""

from __future__ import annotations

import pytest
import simulated_views as rig
from simulated_views import Quality, Truth

from calib.solve import solve
from calib.types import Solution, View
from hw.kinematics import forward


@pytest.fixture(scope="session")
def true() -> Truth:
    return rig.truth(1)


@pytest.fixture(scope="session")
def views(true: Truth) -> list[View]:
    return rig.views(true, seed=1, quality=Quality(0.1, 5e-5))


@pytest.fixture(scope="session")
def solution(views: list[View]) -> Solution:
    return solve(views, rig.SETUP, forward)
