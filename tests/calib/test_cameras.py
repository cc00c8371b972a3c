"""Three real cameras around one arm, and one small marker of unknown size: each alone, and one target pose shared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import real_views

from calib.errors import TooFewViews, UnusableViews
from calib.foreign.cameras import CameraViews, JointSolution, solve_together
from calib.foreign.sizing import solve_any_size
from calib.geometry import distance_mm
from calib.types import Mounting, Setup
from hw.types import Array


def cameras() -> list[CameraViews]:
    return [CameraViews(f"camera-{k}", tuple(real_views.views(k)), real_views.setup(k), None) for k in range(3)]


@pytest.fixture(scope="module")
def together() -> JointSolution:
    return solve_together(cameras())


def room_px(X_BC: Sequence[Array]) -> float:
    """Markers that lie still in the room, triangulated from all cameras that see them: how well do the rays meet?"""
    off = []
    for seen in real_views.room_corners():
        P = {k: real_views.camera(k).K @ np.linalg.inv(X_BC[k])[:3] for k in seen}
        for j in range(4):
            rows = [r for k, px in seen.items() for r in (px[j, 0] * P[k][2] - P[k][0], px[j, 1] * P[k][2] - P[k][1])]
            point = np.linalg.svd(np.array(rows))[2][-1]
            for k, px in seen.items():
                u, v, w = P[k] @ point
                off.append(np.hypot(u / w - px[j, 0], v / w - px[j, 1]))
    return float(np.sqrt(np.mean(np.square(off))))


def test_the_shared_solution_predicts_what_it_has_not_seen(together: JointSolution) -> None:
    assert together.held_out_px < 0.9
    assert together.size_sigma < 2e-3
    assert "of 39.9" in together.target
    assert [len(camera.used) for camera in together.cameras] == [len(real_views.corners(k)) for k in range(3)]


@pytest.mark.long
def test_it_is_better_than_each_alone_by_markers_that_took_no_part(together: JointSolution) -> None:
    alone = [real_views.solved(k)[0].X_AC for k in range(3)]
    assert room_px([camera.X_BC for camera in together.cameras]) < 0.75 * room_px(alone)
    known = [camera.worst_95_mm / camera.alone_worst_95_mm for camera in together.cameras]
    assert np.mean(known) < 0.9


def test_folders_that_do_not_belong_together_are_refused() -> None:
    one, two, three = cameras()
    with pytest.raises(UnusableViews, match="calibrate solve"):
        solve_together([one])
    with pytest.raises(UnusableViews, match=two.name):
        solve_together([one, replace(two, setup=replace(two.setup, mounting=Mounting.WRIST))])
    moved = [replace(v, X_BF=real_views.X_BF[(int(v.name) + 1) % 20]) for v in three.views]
    with pytest.raises(UnusableViews, match=rf"view \d+ of {three.name}"):
        solve_together([two, replace(three, views=tuple(moved))])
    renamed = tuple(replace(v, name=f"x{v.name}") for v in three.views)
    with pytest.raises(TooFewViews, match=r"^0 postures"):
        solve_together([two, replace(three, views=renamed)])
    known = replace(three.setup, size_known=True, board=three.setup.board.scaled(0.8))
    with pytest.raises(UnusableViews, match="different targets"):
        solve_together([two, replace(three, setup=known)])


@pytest.mark.parametrize("number", range(3))
def test_each_camera_by_itself(number: int) -> None:
    """A marker is printed with a size in whole millimetres: 40 here, by the arm's motion to half a per cent."""
    solution, setup = real_views.solved(number)
    assert len(solution.used) == len(real_views.corners(number))
    assert solution.held_out_px < 0.8
    assert 39.5 < 1e3 * setup.board.spacing_m < 40.2
    assert solution.square_scale == pytest.approx(1.0, abs=2e-4)
    assert solution.square_scale_sigma < 5e-3
    assert solution.uncertainty.worst_95_mm < 10.0


def test_a_wrong_guess_of_the_size_ends_in_the_same_place() -> None:
    known = real_views.setup(2)
    one, one_setup = real_views.solved(2)
    large = Setup(Mounting.FIXED, known.board.scaled(9.0), known.colour, size_known=False)
    other, other_setup = solve_any_size(real_views.views(2), large, None)
    assert other_setup.board.spacing_m == pytest.approx(one_setup.board.spacing_m, rel=1e-3)
    assert distance_mm(one.X_AC, other.X_AC) < 0.5
