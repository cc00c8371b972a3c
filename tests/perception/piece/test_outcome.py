"""How a trial ended, from where the piece lies relative to the blade."""

from __future__ import annotations

import numpy as np
import pytest
from table_scenes import at

from hw.types import Array
from perception.piece.proxy import Proxy, Shape
from perception.piece.tracking import outcome_of
from perception.types import Outcome

X_BT = at(0.80, 0.01, 0.035, pitch=-0.25)
PROXY = Proxy(Shape.CYLINDER, (0.012, 0.012, 0.009))
T_S = np.linspace(0.0, 1.2, 37)


def verdict(in_tool_m: tuple[float, float, float], drift_m_s: float = 0.0) -> tuple[Outcome, Array, tuple[str, ...]]:
    points = np.array(in_tool_m) + np.outer(T_S - T_S[-1], [drift_m_s, 0.0, 0.0])
    state = points @ X_BT[:3, :3].T + X_BT[:3, 3]
    return outcome_of(T_S, state, np.full(len(T_S), 0.9), np.tile(X_BT, (len(T_S), 1, 1)), 1.0, PROXY)


def test_on_the_blade() -> None:
    outcome, end_in_tool_m, flags = verdict((-0.05, 0.01, 0.009))
    assert outcome is Outcome.ON_BLADE and flags == ()
    assert end_in_tool_m == pytest.approx([-0.05, 0.01, 0.009])


@pytest.mark.parametrize(
    ("place", "outcome"),
    [
        ((0.03, 0.0, -0.02), Outcome.ON_TABLE),
        ((-0.05, 0.0, -0.03), Outcome.ON_TABLE),
        ((-0.05, 0.06, -0.03), Outcome.ON_TABLE),
        ((-0.12, 0.0, 0.0), Outcome.ON_TABLE),
        ((0.1, 0.0, -0.15), Outcome.LOST),  # below the table
    ],
)
def test_beside_or_under_the_blade_and_lost(place: tuple[float, float, float], outcome: Outcome) -> None:
    assert verdict(place)[0] is outcome


@pytest.mark.parametrize("x, outcome", [(-0.001, Outcome.ON_BLADE), (0.001, Outcome.ON_TABLE)])
def test_at_the_rim_is_uncertain(x: float, outcome: Outcome) -> None:
    found, _, flags = verdict((x, 0.0, 0.009))
    assert found is outcome
    assert any(flag.startswith("outcome uncertain") for flag in flags)


def test_still_sliding_is_flagged() -> None:
    assert any("still moving" in flag for flag in verdict((-0.05, 0.0, 0.009), drift_m_s=0.1)[2])
