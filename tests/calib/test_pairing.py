"""Real views of one camera, doctored: each fault is told from the others, and its remedy mends it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import real_views
import simulated_views as rig
from campaigns import campaign

from calib.errors import UnusableViews
from calib.foreign.pairing import Fault, exchanged, faults, shifted
from calib.foreign.sizing import solve_any_size
from calib.geometry import distance_mm, move
from calib.types import Setup, Solution, View
from hw.kinematics import forward
from hw.poses import inverse
from hw.types import Array
from perception.board.types import Corners


@pytest.fixture(scope="module")
def known() -> tuple[Solution, Setup]:
    return solve_any_size(real_views.views(2), real_views.setup(2), None)


def found(views: Sequence[View]) -> tuple[Fault, ...]:
    setup = real_views.setup(2)
    try:
        solution, sized = solve_any_size(views, setup, None)
    except UnusableViews:
        return faults(views, setup, None, None)
    return faults(views, sized, None, solution)


def seen_elsewhere(view: View, known: tuple[Solution, Setup], X_AC: Array, X_HM: Array) -> View:
    """The same picture as if target and camera were elsewhere: the real corners, moved as the model moves."""
    solution, setup = known
    assert view.X_BF is not None
    px = []
    for a, m in ((solution.X_AC, solution.X_HM), (X_AC, X_HM)):
        X = inverse(a) @ view.X_BF @ m
        p = (setup.board.p_MK_m @ X[:3, :3].T + X[:3, 3]) @ setup.colour.K.T
        px.append(p[:, :2] / p[:, 2:])
    return replace(view, corners=Corners(view.corners.ids, view.corners.px + px[1] - px[0]))


def test_nothing_is_said_of_good_views() -> None:
    assert found(real_views.views(2)) == ()


@pytest.mark.long
def test_two_exchanged_views(known: tuple[Solution, Setup]) -> None:
    views = exchanged(real_views.views(2), [("05", "12")])
    (fault,) = found(views)
    assert fault.kind == "exchanged"
    assert fault.sentence.startswith("05 and 12 look swapped")
    assert fault.option == "--exchange 05:12"
    mended, _ = solve_any_size(exchanged(views, [("05", "12")]), real_views.setup(2), None)
    assert len(mended.used) == 20
    with pytest.raises(UnusableViews, match="view 99"):
        exchanged(views, [("05", "99")])


@pytest.mark.long
@pytest.mark.parametrize("by", [1, -1])
def test_all_shifted_by_one(by: int) -> None:
    views = shifted(real_views.views(2), -by)
    (fault,) = found(views)
    assert fault.kind == "shifted"
    assert fault.option == f"--shift {by}"
    mended, _ = solve_any_size(shifted(views, by), real_views.setup(2), None)
    assert len(mended.used) == 18


@pytest.mark.long
def test_a_picture_lost_near_the_end() -> None:
    views = real_views.views(2)
    views[13:] = [replace(view, X_BF=other.X_BF) for view, other in zip(views[13:], views[12:], strict=False)]
    assert {fault.kind for fault in found(views)} == {"lost"}


def test_stale_joints() -> None:
    views = real_views.views(2)
    views[8] = replace(views[8], X_BF=views[7].X_BF)
    (fault,) = found(views)
    assert fault.kind == "stale"
    assert fault.views == ("08",)
    assert "07" in fault.sentence


def test_an_old_frame() -> None:
    views = real_views.views(2)
    views[8] = replace(views[8], corners=views[7].corners)
    (fault,) = found(views)
    assert fault.kind == "repeated picture"
    assert fault.views == ("08",)


TWIST = np.array([0.05, -0.04, 0.03, 0.012, -0.01, 0.008])


@pytest.mark.parametrize("change", campaign([("slipped", 10), ("slipped", 13), ("moved", 13), ("moved", 10)], 2))
def test_a_slipped_board_and_a_moved_camera_are_told_apart(
    change: tuple[str, int], known: tuple[Solution, Setup]
) -> None:
    solution, _ = known
    what, first = change
    X_AC, X_HM = solution.X_AC, solution.X_HM
    X_AC, X_HM = (move(X_AC, TWIST), X_HM) if what == "moved" else (X_AC, move(X_HM, TWIST))
    views = [
        view if i < first else seen_elsewhere(view, known, X_AC, X_HM) for i, view in enumerate(real_views.views(2))
    ]
    (fault,) = found(views)
    assert fault.kind == what
    assert ("the board slipped" if what == "slipped" else "the camera was moved") in fault.sentence
    assert f"between {first - 1:02d} and {first:02d}" in fault.sentence
    assert fault.option in (f"--until {first - 1:02d}", f"--from {first:02d}")
    good = views[:first] if "until" in fault.option else views[first:]
    alone, _ = solve_any_size(good, real_views.setup(2), None)
    assert distance_mm(alone.X_AC, X_AC if "from" in fault.option else solution.X_AC) < 25.0


@pytest.mark.long
def test_three_lost_pictures_are_placed_and_the_views_that_agree_are_named() -> None:
    """Numbered 1 to 56 without 24, 44 and 53, with the first 53 poses."""
    true = rig.truth(5)
    every = rig.views(true, count=56, seed=5)
    pictures = [view for number, view in enumerate(every, start=1) if number not in (24, 44, 53)]
    views = [replace(picture, name=f"{i:02d}", q_rad=every[i].q_rad) for i, picture in enumerate(pictures)]
    with pytest.raises(UnusableViews):
        solve_any_size(views, rig.SETUP, forward)
    (fault,) = faults(views, rig.SETUP, forward, None)
    assert fault.kind == "lost"
    assert "shifted from view 23 (by +1), 42 (by +2)" in fault.sentence
    assert "23 views agree as they are, 00 to 22" in fault.sentence
