"""From set-downs to table and tool: what they give back, with which intervals, and what does not fit together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touch_rig import HARDWARE

from adaptsim_cli.bench.touch_off.guiding import touches_of
from adaptsim_cli.bench.touch_off.solving import Result, solve
from hw.collision import Table
from hw.kinematics import forward
from hw.poses import pose
from hw.types import Array
from sim.panda.model import inverse
from sim.panda.setting_down import TABLE, SetDown, set_downs
from sim.panda.tool import ToolCorrection, touchable

TOUCHED = touchable(HARDWARE)
CENTRE_M = np.array(TOUCHED.centre_m)
PLACES = set_downs(TOUCHED.feelers, TOUCHED.centre_m)
TRUE = ToolCorrection(Table(-0.007, 0.004, -0.003), 0.003, -0.0025, 0.05, -0.012)


def set_down(where: SetDown, true: ToolCorrection, up_m: tuple[float, float]) -> Array:
    """(7,) joints that hold both corners, left and right, so far over the true table."""
    left, right = where.corners
    roll_rad = (up_m[0] - up_m[1]) / float(np.linalg.norm(left.p_T_m - right.p_T_m))
    c, s, r = np.cos(where.pitch_rad), np.sin(where.pitch_rad), roll_rad
    R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[1, 0, 0], [0, 1, -r], [0, r, 1]])
    at_m = np.array([*where.xy_m, left.radius_m + np.mean(up_m)]) - R @ (left.p_T_m + right.p_T_m) / 2
    X_BF = true.table.X_BW @ pose(R, at_m) @ np.linalg.inv(true.X_FT(HARDWARE.X_FT))
    q = inverse(X_BF, np.linspace(-2.5, 2.5, 101)).reshape(-1, 7)
    return np.asarray(q[np.isfinite(q).all(axis=1)][0])


def solved(
    seed: int = 0, std_m: float = 0.0, true: ToolCorrection = TRUE, lifted_m: float = 0.0
) -> tuple[Result, tuple[str, ...]]:
    """With errors of a hand; at the last place of the table something lies under the edge."""
    rng, postures = np.random.default_rng(seed), []
    for number, where in enumerate(PLACES):
        shared, left, right = std_m * rng.standard_normal(3)
        up = lifted_m if number == TABLE - 1 else 0.0
        postures.append(set_down(where, true, (up + shared + left, up + shared + right)))
    return solve(*touches_of(PLACES, postures, HARDWARE.X_FT), HARDWARE.X_FT, CENTRE_M)


def test_perfect_set_downs_give_the_edge_back_and_how_the_tool_is_turned() -> None:
    """The edge cannot tell the tool's height from the table's, so each alone is off by the same."""
    result, problems = solved()
    assert problems == ()
    assert result.tool_pitch_rad.value == pytest.approx(TRUE.pitch_rad, abs=5e-3)
    assert result.tool_roll_rad.value == pytest.approx(TRUE.roll_rad, abs=2e-3)
    assert result.misfit_m < 2e-4
    found = ToolCorrection(
        Table(result.table_origin_m, result.tilt_x.value, result.tilt_y.value),
        result.tool_height_m.value,
        result.tool_forward_m.value,
        result.tool_pitch_rad.value,
        result.tool_roll_rad.value,
    )
    edge = PLACES[TABLE - 1]
    X_BT = forward(set_down(edge, found, (0.0, 0.0))) @ TRUE.X_FT(HARDWARE.X_FT)
    middle_m = (X_BT @ np.append((edge.corners[0].p_T_m + edge.corners[1].p_T_m) / 2, 1.0))[:3]
    assert middle_m[2] - edge.corners[0].radius_m == pytest.approx(float(TRUE.table.height_at(middle_m)), abs=2e-4)


def test_the_stated_interval_of_the_pitch_holds_for_hands_that_err() -> None:
    inside = []
    for seed in range(40):
        result, _ = solved(seed, 3e-4)
        pitch = result.tool_pitch_rad
        inside.append(abs(pitch.value - TRUE.pitch_rad) <= pitch.within)
        assert pitch.within < np.deg2rad(4.0)
    assert np.mean(inside) >= 0.9


def test_what_does_not_fit_together_is_a_problem() -> None:
    _, problems = solved(std_m=1e-4, true=replace(TRUE, pitch_rad=0.12))
    assert any("pitch" in problem for problem in problems)
    _, problems = solved(std_m=1e-4, lifted_m=0.006)
    assert any("nothing lies there" in problem for problem in problems)
    edge, tool = touches_of(PLACES, [set_down(where, TRUE, (0.0, 0.0)) for where in PLACES], HARDWARE.X_FT)
    with pytest.raises(ValueError, match="3 places"):
        solve(edge[:2], tool, HARDWARE.X_FT, CENTRE_M)
