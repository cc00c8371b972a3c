"""How a trial ended, from where the piece lies relative to the blade."""

from __future__ import annotations

import numpy as np
import pytest

from hw.types import Array
from perception.piece.outcome import TrialEnd, judge
from perception.piece.proxy import Proxy, Shape
from perception.types import Outcome

PROXY = Proxy(Shape.CYLINDER, (0.012, 0.012, 0.009))
T_S = np.linspace(0.0, 1.2, 37)


def pose(pitch: float = -0.25) -> Array:
    c, s = np.cos(pitch), np.sin(pitch)
    X = np.eye(4)
    X[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    X[:3, 3] = 0.80, 0.01, 0.035
    return X


def verdict(in_tool_m: tuple[float, float, float], seen: float = 0.9, drift_m_s: float = 0.0) -> TrialEnd:
    points = np.array(in_tool_m) + np.outer(T_S - T_S[-1], [drift_m_s, 0.0, 0.0])
    state = points @ pose()[:3, :3].T + pose()[:3, 3]
    return judge(T_S, state, np.full(len(T_S), seen), np.tile(pose(), (len(T_S), 1, 1)), 1.0, PROXY)


def test_on_the_blade() -> None:
    end = verdict((-0.05, 0.01, 0.009))
    assert end.outcome is Outcome.ON_BLADE and end.flags == ()
    assert end.end_in_tool_m == pytest.approx([-0.05, 0.01, 0.009])


@pytest.mark.parametrize("place", [(0.03, 0.0, -0.02), (-0.05, 0.0, -0.03), (-0.05, 0.06, -0.03), (-0.12, 0.0, 0.0)])
def test_beside_or_under_the_blade(place: tuple[float, float, float]) -> None:
    assert verdict(place).outcome is Outcome.ON_TABLE


@pytest.mark.parametrize("x, outcome", [(-0.001, Outcome.ON_BLADE), (0.001, Outcome.ON_TABLE)])
def test_at_the_rim_is_uncertain(x: float, outcome: Outcome) -> None:
    end = verdict((x, 0.0, 0.009))
    assert end.outcome is outcome
    assert any(flag.startswith("outcome uncertain") for flag in end.flags)


def test_still_sliding_is_flagged() -> None:
    assert any("still moving" in flag for flag in verdict((-0.05, 0.0, 0.009), drift_m_s=0.1).flags)


def test_out_of_sight_is_lost() -> None:
    assert verdict((-0.05, 0.0, 0.009), seen=0.05).outcome is Outcome.LOST


def test_below_the_table_is_lost() -> None:
    assert verdict((0.1, 0.0, -0.15)).outcome is Outcome.LOST
