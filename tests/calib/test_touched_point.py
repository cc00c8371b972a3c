"""A corner that is seen and touched: what it says of a calibration, and when it says nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import simulated_views as rig
from scipy.spatial.transform import Rotation
from simulated_views import Truth

from calib import touch
from calib.geometry import move
from calib.projection import project
from calib.types import Grade, Solution
from hw.types import Array
from perception.board.types import Corners

CORNER = 14
TIP_M = np.array([0.002, -0.003, 0.16])


def laid(true: Truth) -> tuple[Corners, Array]:
    """Corners of the board flat on the table, and where its `CORNER` is in the base (3,)."""
    X_BM = np.eye(4)
    X_BM[:3, :3] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    X_BM[:3, 3] = 0.55, -0.14, 0.006
    p = rig.SETUP.board.p_MK_m
    px = project(rig.SETUP.colour, (np.linalg.inv(true.X_AC) @ X_BM)[None], p[None])[0]
    px = px + np.random.default_rng(0).normal(0, 0.1, px.shape)
    return Corners(np.arange(len(p)), px), X_BM[:3, :3] @ p[CORNER] + X_BM[:3, 3]


def touches(p_B_m: Array, lean_deg: float = 30.0, scatter_m: float = 3e-4, count: int = 4) -> Array:
    """(N, 4, 4) X_BF with the tip at that point, leaning to four sides."""
    rng, out = np.random.default_rng(1), []
    for i in range(count):
        about = np.deg2rad(lean_deg) * np.array([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2), 0.0])
        X = np.eye(4)
        X[:3, :3] = Rotation.from_rotvec(about).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        X[:3, 3] = p_B_m + scatter_m * rng.standard_normal(3) - X[:3, :3] @ TIP_M
        out.append(X)
    return np.array(out)


def test_touches_give_the_point_and_the_tip() -> None:
    p = np.array([0.6, 0.1, 0.02])
    exact = touch.pivot(touches(p, scatter_m=0.0))
    np.testing.assert_allclose(exact.p_AT_m, p, atol=1e-9)
    np.testing.assert_allclose(exact.p_FT_m, TIP_M, atol=1e-9)
    assert exact.scatter_m < 1e-9


def test_the_stated_error_of_the_point_is_its_scatter_over_many_tries() -> None:
    p, off, stated = np.array([0.6, 0.1, 0.02]), [], []
    for seed in range(200):
        X = touches(p, scatter_m=0.0)
        X[:, :3, 3] += 1e-3 * np.random.default_rng(seed).standard_normal((4, 3))
        found = touch.pivot(X)
        off.append(float(np.linalg.norm(found.p_AT_m - p)))
        stated.append(found.sigma_m)
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(np.sqrt(np.mean(np.square(off))), rel=0.15)


def test_a_good_calibration_meets_the_touch_and_a_moved_one_is_refused(true: Truth, solution: Solution) -> None:
    corners, p = laid(true)
    good = touch.check(solution, rig.SETUP, corners, CORNER, touches(p))
    assert good.verdict is Grade.GOOD
    assert good.value < 1.5
    assert f"{1e3 * np.linalg.norm(TIP_M):.0f} mm from the flange" in good.message
    moved = replace(solution, X_AC=move(solution.X_AC, np.array([0, 0, 0, 0.006, 0, 0])))
    bad = touch.check(moved, rig.SETUP, corners, CORNER, touches(p))
    assert bad.verdict is Grade.BAD
    assert bad.value == pytest.approx(6.0, abs=1.5)


def test_touches_that_cannot_tell_say_why(true: Truth, solution: Solution) -> None:
    corners, p = laid(true)

    def found(X: Array) -> str:
        check = touch.check(solution, rig.SETUP, corners, CORNER, X)
        assert check.verdict is Grade.NOT_MEASURED
        return check.message

    assert "3 touches" in found(touches(p, count=3))
    assert "20 to 40°" in found(touches(p, lean_deg=2.0))
    assert "20 to 40°" in found(np.repeat(touches(p)[:1], 4, axis=0))
    slipped = touches(p)
    slipped[2, :3, 3] += 0.02
    assert f"limit {1e3 * touch.LIMIT_SCATTER_M:.0f} mm" in found(slipped)
