"""A path at a slower pace: the same places, later, and every limit kept."""

from __future__ import annotations

import numpy as np
import pytest
from cells import READY, cell, move, stick

from hw.braking import slowed
from hw.types import ContactWindow, JointPath


def path() -> JointPath:
    return move(np.full(7, 0.2), 1.0, ContactWindow(0.25, 0.5, 0.002, 10.0))


@pytest.mark.parametrize("pace", [0.1, 0.3, 0.77, 0.999])
def test_a_slower_path_visits_the_same_places_within_every_limit(pace: float) -> None:
    slow, within = slowed(path(), pace), cell("panda", stick((0.0, 0.0, 0.1)))
    assert slow.duration_s == pytest.approx(1.0 / pace, abs=1e-3)
    assert slow.contact is not None
    assert (slow.contact.start_s, slow.contact.end_s) == pytest.approx((0.25 / pace, 0.5 / pace))
    assert (slow.contact.depth_m, slow.contact.force_N) == (0.002, 10.0)
    np.testing.assert_array_equal(slow.q_rad[0], path().q_rad[0])
    np.testing.assert_allclose(slow.q_rad[-1], path().q_rad[-1], atol=1e-12)
    at = np.rint(slow.t_s * pace * 1e3).astype(int)
    step = np.abs(np.diff(path().q_rad, axis=0)).max()
    assert np.abs(slow.q_rad - path().q_rad[np.minimum(at, 1000)]).max() <= step
    fast = {check.quantity: check.ratio for check in within.require(path(), READY).checks}
    for check in within.require(slow, READY).checks:
        if check.quantity in ("velocity", "acceleration", "jerk", "travel speed"):
            assert check.ratio <= fast[check.quantity]


def test_full_pace_is_the_path_itself() -> None:
    one = path()
    assert slowed(one, 1.0) is one


@pytest.mark.parametrize("pace", [0.0, -1.0, 0.05, 1.1, float("nan"), float("inf")])
def test_no_other_pace(pace: float) -> None:
    with pytest.raises(ValueError, match="pace"):
        slowed(path(), pace)
