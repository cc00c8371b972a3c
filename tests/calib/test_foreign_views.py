"""A real Panda before three RealSense cameras, one small marker of unknown size: solved from the pictures alone."""

from __future__ import annotations

import numpy as np
import pytest
import real_views

from calib.foreign.labelling import told_apart
from calib.foreign.sizing import solve_any_size
from calib.geometry import angle_deg, distance_mm
from calib.types import Mounting, Setup, View
from perception.board.targets import Chessboard
from perception.board.types import Corners


@pytest.mark.parametrize("number", range(3))
def test_each_camera_by_itself(number: int) -> None:
    """A marker is printed with a size in whole millimetres: 40 here, by the arm's motion to half a per cent."""
    solution, setup = solve_any_size(real_views.views(number), real_views.setup(number), None)
    assert len(solution.used) == len(real_views.corners(number))
    assert solution.held_out_px < 0.8
    assert 39.5 < 1e3 * setup.board.spacing_m < 40.2
    assert solution.square_scale == pytest.approx(1.0, abs=2e-4)
    assert solution.square_scale_sigma < 5e-3
    assert solution.uncertainty.worst_95_mm < 10.0


def test_a_wrong_guess_of_the_size_ends_in_the_same_place() -> None:
    known = real_views.setup(2)
    one, one_setup = solve_any_size(real_views.views(2), known, None)
    large = Setup(Mounting.FIXED, known.board.scaled(9.0), known.colour, size_known=False)
    other, other_setup = solve_any_size(real_views.views(2), large, None)
    assert other_setup.board.spacing_m == pytest.approx(one_setup.board.spacing_m, rel=1e-3)
    assert distance_mm(one.X_AC, other.X_AC) < 0.5


def test_a_chessboard_that_may_be_read_upside_down() -> None:
    """The real postures and camera, a board in place of the marker; every other picture numbered from the other end."""
    solution, _ = solve_any_size(real_views.views(2), real_views.setup(2), None)
    board = Chessboard(8, 6, 0.025)
    setup = Setup(Mounting.FIXED, board, real_views.camera(2))
    rng = np.random.default_rng(0)
    seen = []
    for i in range(real_views.POSTURES):
        X = np.linalg.inv(solution.X_AC) @ real_views.X_BF[i] @ solution.X_HM
        p = board.p_MK_m @ X[:3, :3].T + X[:3, 3]
        px = (p @ setup.colour.K.T)[:, :2] / p[:, 2:] + rng.normal(0.0, 0.1, (board.corners, 2))
        seen.append(
            View(f"{i:02d}", Corners(np.arange(board.corners), px[::-1] if i % 3 else px), X_BF=real_views.X_BF[i])
        )
    found, _ = solve_any_size(told_apart(seen, setup, None), setup, None)
    assert len(found.used) == real_views.POSTURES
    assert found.fit_px < 0.5
    assert distance_mm(found.X_AC, solution.X_AC) < 1.0
    assert angle_deg(found.X_AC, solution.X_AC) < 0.1
