"""Which views help, on real views of a Panda (tests/data/panda-realsense) and on simulated ones."""

from __future__ import annotations

import real_views
import simulated_views as rig

from calib.solve import solve
from hw.kinematics import forward


def test_every_view_that_was_used_has_a_worth_and_more_views_lower_the_error() -> None:
    whole, _ = real_views.solved(2)
    shares = [share for _, share in whole.worth.without]
    assert {name for name, _ in whole.worth.without} == set(whole.used)
    assert shares == sorted(shares, reverse=True)
    assert min(shares) > -0.05
    worth = whole.worth
    assert 0.5 < worth.left < 1.0
    assert worth.to_halve is None or worth.to_halve > 3
    assert set(worth.more) <= set(whole.used)
    assert ", ".join(worth.more) in worth.sentences[-1]


def test_it_hurts_more_to_lose_the_helpful_views_than_the_others() -> None:
    """Simulated views, whose noise is the same in all."""
    views = rig.views(rig.truth())
    whole = solve(views, rig.SETUP, forward)
    order = [name for name, _ in whole.worth.without]

    def stated_mm(lost: list[str]) -> float:
        return solve([v for v in views if v.name not in lost], rig.SETUP, forward).uncertainty.worst_95_mm

    assert stated_mm(order[:6]) > stated_mm(order[-6:]) > whole.uncertainty.worst_95_mm * 0.9
