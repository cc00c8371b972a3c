"""Intrinsics on trial: the factory states no distortion for a real camera that has some."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import real_views
import simulated_views as rig

from calib.foreign.intrinsics_check import adopted, check, suspicious, trial
from calib.foreign.pixels import PixelUnknowns, adjust, observations, poses, rms_px
from calib.foreign.sizing import solve_any_size
from calib.geometry import move
from calib.projection import LENS, lens_jacobian, project, with_lens
from calib.types import Grade
from hw.kinematics import forward


def test_the_derivatives_of_a_lens() -> None:
    camera = rig.SETUP.colour
    X_CM = np.eye(4)[None]
    X_CM[0, :3, 3] = 0.1, -0.05, 0.8
    p = rig.SETUP.board.p_MK_m[None]
    J = lens_jacobian(camera, X_CM, p)
    for k in range(LENS):
        step = np.zeros(LENS)
        step[k] = 1e-5
        ahead, behind = (project(with_lens(camera, s), X_CM, p) for s in (step, -step))
        np.testing.assert_allclose(J[..., k], (ahead - behind) / 2e-5, atol=1e-3)


@pytest.mark.long
def test_a_real_camera_lacks_its_distortion() -> None:
    views = real_views.views(2)
    solution, setup = real_views.solved(2)
    assert suspicious(solution)
    found = trial(views, setup, solution, None)
    assert found is not None
    assert found.better
    assert found.sentence.startswith("the stated intrinsics have no distortion: k1 = +0.1")
    assert found.refined_px < 0.6 * found.stated_px
    assert check(found, refined=False).verdict is Grade.SUSPECT
    assert "--refine-intrinsics" in check(found, refined=False).message

    refined, _ = solve_any_size(views, adopted(setup, found), None)
    assert refined.held_out_px < 0.7 * solution.held_out_px
    sure, _ = solve_any_size(views, replace(adopted(setup, found), lens_covariance=None), None)
    assert refined.uncertainty.worst_95_mm > 1.2 * sure.uncertainty.worst_95_mm  # a lens from the same views costs


@pytest.mark.long
def test_intrinsics_of_another_resolution_are_named() -> None:
    camera = real_views.camera(2)
    K = camera.K.copy()
    K[:2] *= 0.75
    wrong = replace(real_views.setup(2), colour=replace(camera, K=K))
    views = real_views.views(2)
    solution, setup = solve_any_size(views, wrong, None)
    found = trial(views, setup, solution, None)
    assert found is not None
    assert 1.3 <= np.exp(found.lens[0]) < 1.4
    assert "resolution" in found.sentence
    assert f"{np.exp(found.lens[0]):.3f}" in found.sentence


def test_right_intrinsics_are_left_alone() -> None:
    true = rig.truth(2)
    views = rig.views(true, seed=2)
    solution, setup = solve_any_size(views, rig.SETUP, forward)
    assert not suspicious(solution)
    found = trial(views, setup, solution, forward)
    assert found is not None
    assert not found.better
    assert "no better" in found.sentence
    assert check(found, refined=False).verdict is Grade.GOOD
    assert check(None, refined=False).verdict is Grade.NOT_MEASURED


def test_two_cameras_and_two_mountings_at_once() -> None:
    """Without noise every unknown is found again from a start that is off by a centimetre."""
    target = real_views.MARKER
    cameras = [real_views.camera(0), real_views.camera(2)]
    solved = [real_views.solved(k)[0] for k in (0, 2)]
    truth = PixelUnknowns(
        np.stack([s.X_AC for s in solved]), np.stack([solved[0].X_HM, solved[1].X_HM]), 0.8, np.zeros((2, LENS))
    )
    views = [*real_views.views(0), *real_views.views(2)]
    which = [0] * len(real_views.views(0)) + [1] * len(real_views.views(2))
    of = observations([v.corners for v in views], np.stack([v.X_BF for v in views]), target, cameras[0])
    index = np.asarray(which, dtype=np.int64)
    of = replace(of, cameras=tuple(cameras), camera=index, mounting=index)
    px = np.concatenate(
        [project(cameras[k], poses(truth, of)[of.camera == k], 0.8 * of.p_M_m[of.camera == k]) for k in (0, 1)]
    )
    of = replace(of, px=px)
    assert rms_px(truth, of).max() < 1e-9
    start = replace(truth, X_AC=move(truth.X_AC, np.full((2, 6), 0.01)), scale=0.85)
    found = adjust(of, start, 0.1, scale=True, lens=False)
    np.testing.assert_allclose(found.place.X_AC, truth.X_AC, atol=1e-6)
    assert abs(found.place.scale - 0.8) < 1e-6
