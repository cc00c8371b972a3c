"""What the checks find, and that they are silent where all is well."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import simulated_views as rig
from board_scenes import INFRARED
from scipy.spatial.transform import Rotation
from simulated_views import Quality, Truth, board_in_camera, random_poses, seen

from calib import checks
from calib.drift import drift, unknowns_of
from calib.errors import TooFewViews
from calib.gates import gates_of, of_camera
from calib.geometry import move
from calib.projection import project
from calib.solve import solve
from calib.timing import time_offset
from calib.types import Grade, Mounting, Setup, Solution, View, reasons
from hw.kinematics import forward
from hw.poses import inverse
from hw.types import Array
from perception.board.types import Corners


def test_a_good_calibration_passes_every_gate(solution: Solution) -> None:
    gates = gates_of(solution, rig.SETUP)
    assert reasons(gates) == ()
    assert {gate.verdict for gate in gates} == {Grade.GOOD}


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_a_wrong_square_size_is_measured_and_refused(scale: float) -> None:
    found = solve(rig.views(rig.truth(2, board_scale=scale), seed=2), rig.SETUP, forward)
    assert found.square_scale == pytest.approx(scale, abs=2e-3)
    assert len(found.used) >= 18  # no view is blamed for it
    assert "square size" in {gate.name for gate in gates_of(found, rig.SETUP) if gate.verdict is Grade.BAD}


def test_joint_offsets_are_said_aloud() -> None:
    found = solve(rig.views(rig.truth(3, 2 * rig.OFFSETS_RAD), seed=3), rig.SETUP, forward)
    check = checks.joint_offsets(found)
    assert check.verdict is Grade.SUSPECT
    assert check.value == pytest.approx(4.0, abs=0.3)
    assert "joint 4 reads" in check.message
    assert {gate.name for gate in gates_of(found, rig.SETUP) if gate.verdict is Grade.BAD} <= {"stated error"}


def test_tilts_under_eight_degrees_are_said(true: Truth) -> None:
    rng = np.random.default_rng(4)
    X_CM = np.tile(np.eye(4), (20, 1, 1))
    tilts = np.deg2rad(rng.uniform([-5.6, -5.6, -60], [5.6, 5.6, 60], (20, 3)))
    X_CM[:, :3, :3] = Rotation.from_rotvec(tilts).as_matrix()
    X_CM[:, :3, 3] = rng.uniform([-0.35, -0.2, 0.8], [0.15, 0.1, 1.2], (20, 3))
    uv = project(rig.SETUP.colour, X_CM, np.broadcast_to(rig.SETUP.board.p_MK_m, (20, rig.SETUP.board.corners, 3)))
    uv = uv + rng.normal(0, 0.1, uv.shape)
    X_BF = true.X_AC @ X_CM @ inverse(true.X_HM)
    ids = np.arange(rig.SETUP.board.corners)
    found = solve([View(f"{i:02d}", Corners(ids, uv[i]), X_BF=X_BF[i]) for i in range(20)], rig.SETUP, None)
    check = checks.variety(found)
    assert check.verdict is Grade.SUSPECT
    assert "tilted left" in check.message


def test_an_upside_down_board_is_named_and_harmless(solution: Solution, true: Truth) -> None:
    assert checks.mounting_of_board(solution, true.X_HM).verdict is Grade.GOOD
    upside = true.X_HM.copy()
    upside[:3, :3] = upside[:3, :3] @ Rotation.from_rotvec([0, 0, np.pi]).as_matrix()
    check = checks.mounting_of_board(solution, upside)
    assert check.verdict is Grade.SUSPECT
    assert "upside down" in check.message


def test_the_table_plane() -> None:
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(0.4, 1.0, 2000), rng.uniform(-0.3, 0.3, 2000), rng.normal(0, 1.5e-3, 2000)])
    flat[:300, 2] += 0.05  # something lies there
    good = checks.table_plane(flat)
    assert good.verdict is Grade.GOOD
    assert abs(good.value) < 0.3
    low = flat + np.array([0, 0, -0.006])
    assert checks.table_plane(low).verdict is Grade.SUSPECT
    assert checks.table_plane(low).value == pytest.approx(-6.0, abs=0.3)
    tilted = flat.copy()
    tilted[:, 2] += np.tan(np.deg2rad(0.6)) * (tilted[:, 0] - 0.7)
    assert checks.table_plane(tilted).verdict is Grade.SUSPECT
    assert checks.table_plane(flat[:10]).verdict is Grade.NOT_MEASURED


def test_depth_bias_on_the_board(true: Truth) -> None:
    X_DM = np.eye(4)
    X_DM[:3, :3] = Rotation.from_euler("yx", [20, -15], degrees=True).as_matrix()
    X_DM[:3, 3] = -0.1, -0.08, 0.9
    v, u = np.mgrid[: INFRARED.height, : INFRARED.width]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    rays = cv2.undistortPoints(pixels, INFRARED.K, INFRARED.distortion).reshape(-1, 2)
    z = (X_DM[:3, 2] @ X_DM[:3, 3]) / (np.column_stack([rays, np.ones(len(rays))]) @ X_DM[:3, 2])
    depth = np.round(1e3 * z.reshape(v.shape) + 7.0)
    off = checks.depth_residuals(X_DM, rig.SETUP.board, depth, INFRARED)
    assert len(off) > 1000
    check = checks.depth_bias([off, off, off])
    assert check.value == pytest.approx(7.0, abs=0.3)
    assert check.verdict is Grade.SUSPECT
    assert checks.depth_bias([off - 0.007] * 3).verdict is Grade.GOOD
    assert checks.depth_bias([off]).verdict is Grade.NOT_MEASURED


def test_the_infrared_board_shows_where_the_depth_camera_stands(
    views: list[View], solution: Solution, true: Truth
) -> None:
    factory = np.eye(4)
    factory[:3, :3] = Rotation.from_euler("x", -4.9, degrees=True).as_matrix()
    factory[:3, 3] = -0.032, -0.002, 0.004
    actual = move(factory, np.array([0.004, -0.003, 0.002, 1e-3, -2e-3, 1e-3]))
    setup = Setup(Mounting.FIXED, rig.SETUP.board, rig.SETUP.colour, INFRARED, factory)
    rng = np.random.default_rng(3)
    with_infrared = []
    for view in views:
        assert view.q_rad is not None
        X_DM = inverse(actual) @ board_in_camera(Mounting.FIXED, true, forward(view.q_rad[None]))
        uv = project(INFRARED, X_DM, setup.board.p_MK_m[None])[0] + rng.normal(0, 0.15, (setup.board.corners, 2))
        inside = ((uv > 3) & (uv < [636, 572])).all(axis=1)
        seen_there = Corners(np.flatnonzero(inside), uv[inside]) if inside.sum() >= 8 else None
        with_infrared.append(replace(view, infrared=seen_there))
    X_CD, check = checks.infrared_board(solution, with_infrared, setup, forward)
    assert X_CD is not None
    assert np.linalg.norm(X_CD[:3, 3] - actual[:3, 3]) < 6e-4
    assert check.verdict is Grade.SUSPECT
    assert check.value > 2.0
    none, skipped = checks.infrared_board(solution, views, setup, forward)
    assert none is None
    assert skipped.verdict is Grade.NOT_MEASURED


def _swing(true: Truth, views: list[View], late_s: float) -> tuple[list[tuple[float, Corners]], Array, Array]:
    """A board that swings for 1.2 s, filmed at 30 Hz by a camera whose stamps are late."""
    rng = np.random.default_rng(11)
    start = views[3].q_rad
    assert start is not None
    t = np.arange(0.0, 1.2, 0.004)
    swing = 0.10 * (1 - np.cos(2 * np.pi * t / 1.2)) / 2
    q = start + swing[:, None] * np.array([1.0, 0, 0, 0, 0, 0, 0])
    frames = []
    for moment in np.arange(0.05, 1.15, 1 / 30):
        now = np.stack([np.interp(moment, t, column) for column in q.T])[None]
        uv = project(
            rig.SETUP.colour, board_in_camera(Mounting.FIXED, true, forward(now)), rig.SETUP.board.p_MK_m[None]
        )[0]
        uv = uv + rng.normal(0, 0.1, uv.shape)
        frames.append((moment + late_s, Corners(np.arange(len(uv)), uv)))
    return frames, t, q


@pytest.mark.parametrize("late_ms", [0.0, 33.0, -20.0])
def test_the_time_offset_is_found_within_a_millisecond(
    true: Truth, views: list[View], solution: Solution, late_ms: float
) -> None:
    frames, t, q = _swing(true, views, 1e-3 * late_ms)
    check = time_offset(frames, t, q, solution, rig.SETUP, forward)
    assert check.value == pytest.approx(late_ms, abs=1.0)
    assert check.verdict is (Grade.GOOD if late_ms == 0.0 else Grade.SUSPECT)


def test_the_time_offset_survives_a_calibration_that_is_off(true: Truth, views: list[View], solution: Solution) -> None:
    frames, t, q = _swing(true, views, 0.012)
    off = replace(solution, X_AC=move(solution.X_AC, np.array([0.004, 0.003, 0, 0.005, 0, 0.005])))
    assert time_offset(frames, t, q, off, rig.SETUP, forward).value == pytest.approx(12.0, abs=2.0)


def test_a_motion_too_slow_says_so(true: Truth, views: list[View], solution: Solution) -> None:
    frames, t, q = _swing(true, views, 0.0)
    check = time_offset(frames[:4], t, q, solution, rig.SETUP, forward)
    assert check.verdict is Grade.NOT_MEASURED
    still = [(moment, frames[0][1]) for moment, _ in frames]
    check = time_offset(still, t, np.repeat(q[:1], len(q), axis=0), solution, rig.SETUP, forward)
    assert check.verdict is Grade.NOT_MEASURED
    assert "px/s" in check.message


@pytest.mark.parametrize("seed", range(4))
def test_a_moved_camera_is_told_from_one_that_stands(true: Truth, solution: Solution, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = random_poses(rig.SETUP, true, forward, rig.BOUNDS, 3, rng)
    was = unknowns_of(solution)
    assert not drift(seen(rig.SETUP, true, forward, q, Quality(0.1, 5e-5), rng), rig.SETUP, forward, *was).moved
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    shifted = replace(true, X_AC=move(true.X_AC, np.concatenate([np.zeros(3), 2e-3 * axis])))
    found = drift(seen(rig.SETUP, shifted, forward, q, Quality(0.1, 5e-5), rng), rig.SETUP, forward, *was)
    assert found.moved
    assert found.moved_mm == pytest.approx(2.0, abs=1.0)
    assert "calibrate again" in found.message
    turned = replace(true, X_AC=move(true.X_AC, np.concatenate([np.deg2rad(0.2) * axis, np.zeros(3)])))
    assert drift(seen(rig.SETUP, turned, forward, q, Quality(0.1, 5e-5), rng), rig.SETUP, forward, *was).moved


def test_two_views_are_too_few_for_a_verdict(views: list[View], solution: Solution) -> None:
    with pytest.raises(TooFewViews):
        drift(views[:2], rig.SETUP, forward, *unknowns_of(solution))


def test_a_board_that_slipped_is_dated() -> None:
    true = rig.truth(6)
    slipped = replace(true, X_HM=move(true.X_HM, np.array([0.02, 0, 0, 0.01, 0, 0])))
    before, after = rig.views(true, seed=6), rig.views(slipped, seed=6)
    found = solve([*before[:12], *after[12:]], rig.SETUP, forward)
    assert [view.name for view in found.rejected] == [f"view-{i:03d}" for i in range(12, 20)]
    assert any("view-011 and view-012" in reason for reason in reasons(gates_of(found, rig.SETUP)))


def test_a_calibration_that_fits_badly_is_refused(solution: Solution) -> None:
    bad = {
        gate.name
        for gate in gates_of(replace(solution, held_out_px=2.0, fit_px=1.0), rig.SETUP)
        if gate.verdict is Grade.BAD
    }
    assert bad == {"fit", "held-out error"}


def test_a_noisy_arm_is_named_before_the_intrinsics(solution: Solution) -> None:
    noisy = replace(solution, noise=replace(solution.noise, joint_rad=1e-3, flange_mm=0.9))
    figures = of_camera(noisy, rig.SETUP, fit_px=2.0, held_out_px=2.0, worst_95_mm=9.0)
    (fit,) = (check for check in figures if check.name == "fit")
    assert "the arm's joints are off by 1.0 mrad" in fit.message
    assert "intrinsics" not in fit.message
