"""Which views help, on real views of a Panda (tests/data/panda-realsense) and on simulated ones."""

from __future__ import annotations

import pytest
import real_views
import simulated_views as rig

from calib.foreign.sizing import solve_any_size
from calib.solve import solve
from calib.types import Solution, View
from hw.kinematics import forward


def solved(views: list[View]) -> Solution:
    return solve_any_size(views, real_views.setup(2), None)[0]


@pytest.fixture(scope="module")
def whole() -> Solution:
    return solved(real_views.views(2))


def without(names: set[str]) -> Solution:
    return solved([view for view in real_views.views(2) if view.name not in names])


def test_every_view_that_was_used_has_a_worth(whole: Solution) -> None:
    shares = [share for _, share in whole.worth.without]
    assert {name for name, _ in whole.worth.without} == set(whole.used)
    assert shares == sorted(shares, reverse=True)
    assert min(shares) > -0.05


def test_it_hurts_more_to_lose_the_helpful_views_than_the_others() -> None:
    """Simulated views, whose noise is the same in all."""
    views = rig.views(rig.truth())
    whole = solve(views, rig.SETUP, forward)
    order = [name for name, _ in whole.worth.without]

    def stated_mm(lost: list[str]) -> float:
        return solve([v for v in views if v.name not in lost], rig.SETUP, forward).uncertainty.worst_95_mm

    assert stated_mm(order[:6]) > stated_mm(order[-6:]) > whole.uncertainty.worst_95_mm * 0.9


def test_more_views_lower_the_error_and_enough_of_them_halve_it(whole: Solution) -> None:
    worth = whole.worth
    assert 0.5 < worth.left < 1.0
    assert worth.to_halve is None or worth.to_halve > 3
    assert set(worth.more) <= set(whole.used)
    assert ", ".join(worth.more) in worth.sentences[-1]


def test_views_of_few_postures_ask_for_fewer_more_to_halve_their_error() -> None:
    few = without({f"{i:02d}" for i in range(12, 20)})
    assert few.worth.left < solved(real_views.views(2)).worth.left
