"""Corner errors common to a view, as lenses and prints make: real postures, a board in place of the marker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import real_views
from campaigns import campaign
from repeatability import predicted_px, setup_of, views_of
from scipy.optimize import least_squares

import calib.estimate as estimator
from calib.bundle import Fit
from calib.closed_form import robust_start
from calib.condense import condense
from calib.drift import drift, unknowns_of
from calib.errors import DegenerateViews, TooFewViews
from calib.foreign.intrinsics_check import settle
from calib.foreign.labelling import resolve_symmetry
from calib.foreign.pairing import exchanged, faults
from calib.foreign.sizing import solve_any_size, where_the_target_was
from calib.geometry import distance_mm, move
from calib.projection import project
from calib.solve import solve
from calib.types import Mounting, Setup, View, Weights
from hw.poses import inverse
from hw.types import Array
from perception.board.targets import Points
from perception.board.types import Corners

GRID = Points(np.array([[0.025 * x, 0.025 * y, 0.0] for y in range(5) for x in range(7)]))
SETUP = Setup(Mounting.FIXED, GRID, real_views.camera(2))


def views(common_px: float, seed: int = 0) -> list[View]:
    """A grid of points on the real hand, before real camera 2, with smooth errors of the corners of each view."""
    true, _ = solve_any_size(real_views.views(2), real_views.setup(2), None)
    rng = np.random.default_rng(seed)
    x, y = (2 * GRID.p_MK_m[:, :2] / GRID.p_MK_m[:, :2].max(axis=0) - 1).T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    made = []
    for view in real_views.views(2):
        X = inverse(true.X_AC) @ np.array(view.X_BF) @ true.X_HM
        px = project(SETUP.colour, X[None], GRID.p_MK_m[None])[0]
        px = px + common_px * (rng.standard_normal((2, 6)) @ terms).T / np.sqrt(6) + rng.normal(0, 0.09, px.shape)
        made.append(replace(view, corners=Corners(np.arange(len(px)), px)))
    return made


def by_pixels(some: Sequence[View]) -> Array:
    """X_AC by a soft-L1 bundle adjustment over pixels."""
    X_AH = np.stack([np.array(view.X_BF) for view in some])
    sight = condense([v.name for v in some], [v.corners for v in some], GRID, SETUP.colour)
    X_AC, X_HM = robust_start(X_AH, sight.X_CM[0])

    def off(x: Array) -> Array:
        X = inverse(move(X_AC, x[:6])) @ X_AH @ move(X_HM, x[6:])
        return (project(SETUP.colour, X, sight.p_M_m) - sight.px).ravel()

    found = least_squares(off, np.zeros(12), x_scale=1e-3, loss="soft_l1")
    return move(X_AC, found.x[:6])


@pytest.mark.long
@pytest.mark.parametrize(("camera", "seed", "half"), [(0, 4, 1), (2, 2, 0)])
def test_small_markers_whose_corners_turn_them_are_fitted_together(camera: int, seed: int, half: int) -> None:
    """Each marker's own pose is off by degrees, which cost all views but one, or a camera 50 mm."""
    setup = setup_of("marker", camera)
    every, _ = views_of("marker", camera, setup, 1.0, seed)
    found = solve(every[half::2], setup, None)
    assert len(found.used) == len(every[half::2])
    assert predicted_px(found.X_AC, found.X_HM, every[1 - half :: 2], setup) < 2.0


@pytest.mark.parametrize("common_px", campaign([0.5, 0.2, 1.0], 3))
def test_halves_agree_as_well_as_by_a_plain_fit_over_pixels(common_px: float) -> None:
    ours, plain = [], []
    for seed in range(4):
        some = views(common_px, seed)
        halves = some[::2], some[1::2]
        solved = [solve(half, SETUP, None) for half in halves]
        ours.append(distance_mm(solved[0].X_AC, solved[1].X_AC))
        plain.append(distance_mm(*(by_pixels(half) for half in halves)))
        assert all(not s.rejected for s in solved)
    # equal: the two treat outlying corners differently (a soft-L1 loss there, Huber's weights here)
    assert np.linalg.norm(ours) < 1.05 * np.linalg.norm(plain)


def test_the_common_error_is_told_from_errors_of_the_arm() -> None:
    found = solve(views(0.5), SETUP, None)
    assert 0.2 < found.noise.view_px < 1.0
    assert found.noise.corner_px < 0.3
    assert found.noise.flange_mm < 1.5


def test_the_better_of_two_fits_is_kept_and_named() -> None:
    choice = solve(views(0.5), SETUP, None).choice
    assert choice.held_out_px <= 1.03 * min(choice.errors_px, choice.pixels_px)
    assert all(weights.value in choice.sentence for weights in choice.weights)
    assert f"{choice.pixels_px:.2f} px" in choice.sentence


@pytest.mark.long
@pytest.mark.parametrize(
    ("errors_px", "pixels_px", "kept"),
    [(0.8, 1.0, [Weights.ARM_AND_VIEWS]), (1.0, 0.97, [Weights.PIXELS]), (1.0, 1.0, list(Weights))],
)
def test_the_mean_is_taken_where_neither_fit_predicts_better(
    monkeypatch: pytest.MonkeyPatch, errors_px: float, pixels_px: float, kept: list[Weights]
) -> None:
    """As if the fits had predicted held-out views so well; the mean lies half way between them."""
    told = {Weights.ARM_AND_VIEWS: errors_px, Weights.PIXELS: pixels_px}

    def folds(data: estimator.Data, full: Sequence[Fit]) -> estimator.HeldOutViews:
        return estimator.HeldOutViews(np.arange(1), np.array([told[full[-1].model.weights]]))

    monkeypatch.setattr(estimator, "_folds", folds)
    found = solve(views(0.5), SETUP, None)
    assert list(found.choice.weights) == kept
    alone = {}
    for weights in Weights:
        told.update({w: 0.1 if w is weights else 1.0 for w in Weights})
        alone[weights] = solve(views(0.5), SETUP, None).X_AC[:3, 3]
    assert np.allclose(found.X_AC[:3, 3], np.mean([alone[weights] for weights in kept], axis=0), atol=1e-6)


@pytest.mark.long
def test_a_lens_that_is_not_as_stated_widens_the_stated_error_over_the_true_one() -> None:
    some = views(0.0)
    true, _ = settle(some, SETUP, None)[:2]
    K = SETUP.colour.K.copy()
    K[[0, 1], [0, 1]] *= 1.01
    wrong = replace(SETUP, colour=replace(SETUP.colour, K=K))
    found, _, tried = settle(some, wrong, None)
    assert tried is not None
    p = (SETUP.p_AP_m - true.X_AC[:3, 3]) @ true.X_AC[:3, :3]
    off_mm = 1e3 * np.linalg.norm(p @ found.X_AC[:3, :3].T + found.X_AC[:3, 3] - SETUP.p_AP_m, axis=1).max()
    assert off_mm > 5.0
    assert found.uncertainty.worst_95_mm > off_mm


@pytest.mark.parametrize("times", [1e4, 1e20, 1e300])
def test_a_view_with_corners_far_outside_its_picture_is_left_out(times: float) -> None:
    first, *others = views(0.0)
    spoilt = replace(first, corners=Corners(first.corners.ids, times * first.corners.px))
    found = solve(resolve_symmetry([spoilt, *others], SETUP, None), SETUP, None)
    assert [view.name for view in found.rejected] == [first.name]
    with pytest.raises(TooFewViews, match=f"view {first.name}"):
        drift([spoilt, *others], SETUP, None, *unknowns_of(found))


def test_a_matrix_that_cannot_be_inverted_means_degenerate_views(monkeypatch: pytest.MonkeyPatch) -> None:
    found = solve(views(0.0), SETUP, None)

    def singular(matrix: Array) -> Array:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(np.linalg, "inv", singular)
    with pytest.raises(DegenerateViews):
        solve(views(0.0), SETUP, None)
    with pytest.raises(DegenerateViews):
        drift(views(0.0), SETUP, None, *unknowns_of(found))


@pytest.mark.long
def test_points_numbered_from_the_other_end_count_like_others() -> None:
    some = [
        replace(v, corners=Corners(v.corners.ids, v.corners.px[::-1])) if i % 3 == 1 else v
        for i, v in enumerate(views(0.0))
    ]
    assert len(GRID.turns) == 1
    found = solve(resolve_symmetry(some, SETUP, None), SETUP, None)
    assert len(found.used) == real_views.POSTURES
    assert found.fit_px < 0.3
    swapped = exchanged(some, [("05", "12")])
    told = resolve_symmetry(swapped, SETUP, None)
    (fault,) = faults(told, SETUP, None, solve(told, SETUP, None))
    assert fault.option == "--exchange 05:12"


@pytest.mark.long
def test_an_exchange_that_makes_it_worse_is_named_but_not_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    some = exchanged(views(0.0), [("05", "12")])
    solution = solve(some, SETUP, None)
    monkeypatch.setattr("calib.foreign.pairing._NO_WORSE", 0.01)  # as if the exchanged views were predicted much worse
    (fault,) = faults(some, SETUP, None, solution)
    assert "05 and 12 look swapped" in fault.sentence
    assert "so exchanged" in fault.sentence
    assert fault.option == ""


@pytest.mark.long
def test_a_wrist_camera_declared_fixed_is_named() -> None:
    X_FC = np.eye(4)
    X_FC[:3, 3] = 0.05, 0.0, 0.06
    lying = np.eye(4)
    first = np.array(views(0.0)[0].X_BF) @ X_FC
    lying[:3, :3] = first[:3, :3]
    lying[:3, 3] = first[:3, 3] + first[:3, 2] * 0.8 - first[:3, :3] @ GRID.p_MK_m.mean(axis=0)
    rng = np.random.default_rng(3)
    made = []
    for i in range(14):
        X_BF = move(np.array(views(0.0)[0].X_BF), rng.uniform(-0.12, 0.12, 6))
        px = project(SETUP.colour, (inverse(X_BF @ X_FC) @ lying)[None], GRID.p_MK_m[None])[0]
        made.append(View(f"{i:02d}", Corners(np.arange(len(px)), px + rng.normal(0, 0.1, px.shape)), X_BF=X_BF))
    (fault,) = faults(made, SETUP, None, None)
    assert fault.kind == "mounting"
    assert 'with camera = "wrist" 14 of 14 views fit' in fault.sentence


def test_the_work_volume_of_a_folder_without_one_is_where_the_target_was() -> None:
    points = where_the_target_was(views(0.0), SETUP, None)
    assert points is not None
    true, _ = solve_any_size(real_views.views(2), real_views.setup(2), None)
    centres = (real_views.X_BF @ true.X_HM)[:, :3, 3]
    assert (points.max(axis=0) > np.median(centres, axis=0)).all()
    assert (points.max(axis=0) < centres.max(axis=0) + 0.2).all()
    assert (points.min(axis=0) > centres.min(axis=0) - 0.2).all()
