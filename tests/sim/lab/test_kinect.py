"""The rendered camera: geometry, light, motion blur and the sensor's errors."""

from __future__ import annotations

from functools import lru_cache
from statistics import NormalDist

import cv2
import numpy as np
import pytest
from table_scenes import at, box, cut

from hw.poses import inverse
from hw.types import Array, CameraModel, Intrinsics
from sim.lab.kinect import default_X_BC, kinect_model
from sim.render.rays import STILL, held_still, pixel_rays, within_exposure
from sim.render.renderer import Renderer
from sim.render.sensor import SensorNoise, sense_colour

RNG = np.random.default_rng
HALF_M = 0.02


TABLE = box("world", (0.3, -0.6, -0.03), (1.2, 0.6, 0.0), (0.5, 0.5, 0.5))
BLOCK = box("block", (-HALF_M, -HALF_M, -HALF_M), (HALF_M, HALF_M, HALF_M), (0.6, 0.1, 0.05))


def close_up() -> CameraModel:
    """The work area at full resolution."""
    full = kinect_model()
    return CameraModel("close-up", cut(full.colour, 500, 220, 280, 240), cut(full.depth, 260, 200, 160, 160), full.X_CD)


@lru_cache
def renderer() -> Renderer:
    return Renderer(close_up(), default_X_BC(), [TABLE, BLOCK])


def red(colour: np.ndarray) -> Array:
    return np.asarray(colour[..., 0].astype(int) - colour[..., 2] > 60)


def test_both_sizes_show_the_same_view() -> None:
    full, small = kinect_model(), kinect_model("small")
    assert (full.colour.width, full.colour.height) == (1280, 720)
    assert (full.depth.width, full.depth.height) == (640, 576)
    for big, little in ((full.colour, small.colour), (full.depth, small.depth)):
        points = np.array([[0.1, -0.2, 1.0], [-0.3, 0.1, 1.2]])
        uv, uv_small = (
            cv2.projectPoints(points, np.zeros(3), np.zeros(3), c.K, c.distortion)[0] for c in (big, little)
        )
        assert uv_small == pytest.approx((uv + 0.5) / 4 - 0.5, abs=1e-9)


@pytest.mark.parametrize("which", ["colour", "depth"])
def test_rays_project_back_onto_their_pixels(which: str) -> None:
    camera: Intrinsics = getattr(kinect_model(), which)
    some = pixel_rays(camera)[::23, ::23].reshape(-1, 3).astype(np.float64)
    uv, _ = cv2.projectPoints(some, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    u, v = np.meshgrid(np.arange(0, camera.width, 23), np.arange(0, camera.height, 23))
    assert np.abs(uv.reshape(-1, 2) - np.stack([u, v], axis=-1).reshape(-1, 2)).max() < 0.003


def test_a_body_that_hardly_moves_is_held_until_it_has_moved() -> None:
    drifting = np.stack([at(0.7 + i * STILL / 4, 0.0, HALF_M) for i in range(12)])
    held = held_still(drifting)
    assert len(np.unique(held[:, 0, 3])) == 3
    assert np.abs(held - drifting).max() <= STILL
    moving = np.stack([at(0.7 + 2 * i * STILL, 0.0, HALF_M) for i in range(5)])
    assert np.array_equal(held_still(moving), moving)


def test_the_camera_looks_down_at_the_work_area() -> None:
    X_BC = default_X_BC()
    assert X_BC[:3, :3] @ X_BC[:3, :3].T == pytest.approx(np.eye(3))
    assert X_BC[2, 2] < -0.5 and X_BC[0, 2] < 0  # down and back towards the arm
    assert X_BC[2, 1] < 0  # upright
    p = inverse(X_BC) @ [0.68, 0.0, 0.0, 1.0]
    uv, _ = cv2.projectPoints(
        p[:3], np.zeros(3), np.zeros(3), kinect_model().colour.K, kinect_model().colour.distortion
    )
    assert np.abs(uv.ravel() - [640, 360]).max() < 60


def test_depth_of_table_and_block_is_exact_without_noise() -> None:
    _, depth_mm = renderer().render({"block": at(0.7, 0.0, HALF_M)[None]}, None, RNG(0))
    model = close_up()
    X_BD = default_X_BC() @ model.X_CD
    points = pixel_rays(model.depth) * (depth_mm / 1000.0)[..., None]
    B = points @ X_BD[:3, :3].T + X_BD[:3, 3]
    top = (np.abs(B[..., :2] - [0.7, 0.0]) < HALF_M - 0.004).all(axis=-1) & (B[..., 2] > 0.03)
    bare = (np.abs(B[..., :2] - [0.7, 0.0]) > HALF_M + 0.05).any(axis=-1)
    assert top.sum() > 100 and bare.sum() > 5000
    assert np.abs(B[top][:, 2] - 2 * HALF_M).max() < 0.0006
    assert np.abs(B[bare][:, 2]).max() < 0.0006


def test_colour_lies_where_the_block_is() -> None:
    colour, _ = renderer().render({"block": at(0.70, 0.03, HALF_M)[None]}, None, RNG(0))
    model, X_CB = close_up(), inverse(default_X_BC())
    corners = np.array([[x, y, z] for x in (0.68, 0.72) for y in (0.01, 0.05) for z in (0.0, 0.04)])
    local = corners @ X_CB[:3, :3].T + X_CB[:3, 3]
    uv, _ = cv2.projectPoints(local, np.zeros(3), np.zeros(3), model.colour.K, model.colour.distortion)
    rows, columns = np.nonzero(red(colour))
    assert np.abs(uv.reshape(-1, 2).min(axis=0) - [columns.min(), rows.min()]).max() < 1.5
    assert np.abs(uv.reshape(-1, 2).max(axis=0) - [columns.max(), rows.max()]).max() < 1.5


def test_motion_blurs_across_and_keeps_the_middle() -> None:
    y = np.array([-0.006, -0.002, 0.002, 0.006])
    moving, depth_moving = renderer().render({"block": np.stack([at(0.7, v, HALF_M) for v in y])}, None, RNG(0))
    still, depth_still = renderer().render({"block": at(0.7, 0.0, HALF_M)[None]}, None, RNG(0))
    assert np.array_equal(depth_moving, depth_still)
    share = [c.astype(float)[..., 0] - c[..., 2] for c in (moving, still)]
    columns = np.arange(share[0].shape[1])
    middles = [float((s.sum(axis=0) * columns).sum() / s.sum()) for s in share]
    assert middles[0] == pytest.approx(middles[1], abs=0.15)
    widths = [int((s.max(axis=0) > 8).sum()) for s in share]
    assert widths[0] - widths[1] == pytest.approx(0.012 * 612 / 0.9, abs=2.5)


def test_the_block_throws_a_shadow_away_from_the_lamp() -> None:
    with_block, _ = renderer().render({"block": at(0.7, 0.0, HALF_M)[None]}, None, RNG(0))
    bare, _ = renderer().render({"block": at(0.7, 0.0, -3.0)[None]}, None, RNG(0))
    darker = (bare.astype(int) - with_block).min(axis=-1) > 25
    darker &= ~cv2.dilate(red(with_block).astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    assert 100 < darker.sum() < 3000
    block_column, shadow_column = np.nonzero(red(with_block))[1].mean(), np.nonzero(darker)[1].mean()
    assert shadow_column > block_column + 5  # the lamp stands at negative y, to the left in the image


def test_a_body_out_of_sight_changes_nothing() -> None:
    hidden, depth_hidden = renderer().render({"block": at(0.7, 0.0, -3.0)[None]}, None, RNG(0))
    beside, depth_beside = renderer().render({"block": at(0.7, 3.0, -3.0)[None]}, None, RNG(0))
    assert np.array_equal(hidden, beside) and np.array_equal(depth_hidden, depth_beside)


def test_equal_input_gives_equal_images_whatever_was_rendered_before() -> None:
    here, there = ({"block": at(x, 0.01, HALF_M)[None], "unseen": np.eye(4)[None]} for x in (0.68, 0.70))
    first, other, moved, again = (
        renderer().render(poses, SensorNoise(), RNG(seed))
        for poses, seed in ((here, 5), (here, 6), (there, 5), (here, 5))
    )
    afresh = Renderer(close_up(), default_X_BC(), [TABLE, BLOCK]).render(here, SensorNoise(), RNG(5))
    for i in range(len(first)):
        assert np.array_equal(first[i], again[i]) and np.array_equal(first[i], afresh[i])
        assert not np.array_equal(first[i], other[i]) and not np.array_equal(first[i], moved[i])


def test_a_lacking_pose_is_named() -> None:
    with pytest.raises(ValueError, match=r"no pose for the visible bodies \['block'\]"):
        renderer().render({}, None, RNG(0))


def test_depth_noise_is_of_the_stated_size_and_its_bias_stays() -> None:
    poses = {"block": at(0.7, 0.0, -3.0)[None]}
    noise = SensorNoise.draw(RNG(11))
    exact = renderer().render(poses, None, RNG(0))[1].astype(float)
    shots = np.stack([renderer().render(poses, noise, RNG(seed))[1] for seed in range(6)]).astype(float)
    off = (shots - exact)[:, (shots > 0).all(axis=0)]
    assert 1.0 < off.std(axis=0).mean() < 2.5
    bias = off.mean(axis=1)
    assert np.ptp(bias) < 0.1 and abs(bias.mean()) < 5.0
    perfect = SensorNoise.draw(RNG(11), depth_noise_scale=0.0)
    assert np.array_equal(renderer().render(poses, perfect, RNG(3))[1], exact)
    triple = renderer().render(poses, SensorNoise.draw(RNG(11), 3.0), RNG(3))[1] - exact
    assert triple.std() > 2 * off.std(axis=0).mean()


def test_edges_have_holes_and_flying_pixels() -> None:
    poses = {"block": at(0.7, 0.0, 0.10)[None]}
    exact = renderer().render(poses, None, RNG(0))[1].astype(int)
    noisy = renderer().render(poses, SensorNoise(), RNG(1))[1].astype(int)
    kernel = np.ones((3, 3), np.uint8)
    jump = cv2.dilate(exact.astype(np.uint16), kernel).astype(int) - cv2.erode(exact.astype(np.uint16), kernel) > 30
    assert 0.3 < (noisy[jump] == 0).mean() < 0.6
    assert (np.abs(noisy - exact)[jump & (noisy > 0)] > 10).mean() > 0.2
    assert (noisy[~jump] == 0).mean() < 0.01


def test_poses_within_an_exposure() -> None:
    X = np.stack([at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0)])
    assert within_exposure(X, np.array([0.0, 0.25, 0.5, 0.75, 1.0]))[:, 0, 3] == pytest.approx([0, 0, 0.5, 1, 1])
    assert within_exposure(X[:1], np.array([0.1, 0.9]))[:, 0, 3] == pytest.approx([0, 0])
    turn = np.eye(4)
    turn[:2, :2] = [[0, -1], [1, 0]]
    R = within_exposure(np.stack([np.eye(4), turn]), np.array([0.5]))[0, :3, :3]
    assert pytest.approx(np.eye(3)) == R @ R.T and R[0, 0] == pytest.approx(np.sqrt(0.5))


def test_colour_noise_is_normal_and_of_the_stated_size() -> None:
    grey = np.full((360, 640, 3), 128, dtype=np.uint8)
    noise = SensorNoise(colour_std=6.0)
    off = (sense_colour(grey, noise, RNG(4)) - grey.astype(float)).astype(int)
    luma = 6.0 * np.sqrt(1.25)  # of red and blue: brightness and half as much colour
    assert off.std(axis=(0, 1))[[0, 2]] == pytest.approx(luma, rel=0.01)
    assert off.mean(axis=(0, 1)) == pytest.approx(0.0, abs=0.1)
    for levels in (3, 7, 14, 21):
        share = 2 * NormalDist(sigma=luma).cdf(levels + 0.5) - 1  # rounded to whole levels
        assert (np.abs(off[..., 0]) <= levels).mean() == pytest.approx(share, abs=0.005)
    tint = off[..., 0] - off[..., 2]  # the same within a block of two by two pixels but for rounding
    assert np.abs(tint[::2, ::2] - tint[1::2, 1::2]).max() <= 2
    assert np.corrcoef(tint[::2, ::2].ravel(), tint[::2, 1::2].ravel())[0, 1] > 0.95
    assert abs(np.corrcoef(tint[:, 1:-1:2].ravel(), tint[:, 2::2].ravel())[0, 1]) < 0.02


def test_what_rests_and_what_moves_are_painted_alike() -> None:
    plate = box("plate", (-0.06, -0.06, 0.0), (0.06, 0.06, 0.004), (0.1, 0.2, 0.6))
    scene = Renderer(close_up(), default_X_BC(), [TABLE, BLOCK, plate])
    block = np.stack([at(0.69 + 0.002 * i, 0.0, HALF_M) for i in range(4)])
    over = np.tile(at(0.66, -0.05, 0.12), (4, 1, 1))
    quivering = over.copy()
    quivering[:, 2, 3] += 1e-12 * np.arange(4)
    resting, _ = scene.render({"block": block, "plate": over}, None, RNG(0))
    moving, _ = scene.render({"block": block, "plate": quivering}, None, RNG(0))
    bare, _ = scene.render({"block": block, "plate": at(0.7, 0.0, -3.0)[None]}, None, RNG(0))
    shaded = np.logical_and(red(resting), (bare.astype(int) - resting).max(axis=-1) > 20)
    assert shaded.sum() > 50  # the plate above shades the block that moves
    assert np.array_equal(resting, moving)
