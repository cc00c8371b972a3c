"""The proxy's outline and front agree with each other, with areas known, and with ray casting of its mesh."""

from __future__ import annotations

import numpy as np
import pytest
from table_scenes import at, close_up

from perception.geometry import ImageRegion, project, transform, view_of
from perception.piece.proxy import Proxy, Shape, coverage
from sim.lab.kinect import default_X_BC

HALF = (0.014, 0.011, 0.009)
AREA = (0.64, 0.72, -0.04, 0.04)


def view() -> ImageRegion:
    return view_of(close_up().colour, default_X_BC(), AREA, 0.03)


@pytest.mark.parametrize("shape", list(Shape))
def test_outline_surrounds_exactly_the_rays_that_hit(shape: Shape) -> None:
    scene, X = view(), at(0.68, 0.01, 0.02, pitch=-0.3)
    proxy = Proxy(shape, HALF)
    near, share, _ = coverage(proxy.outline(X, scene), scene.xy.reshape(-1, 2))
    depth, normal = proxy.front(X, scene, scene.directions)
    hit = np.isfinite(depth)
    covered = np.zeros(len(depth))
    covered[near] = share
    assert hit.sum() > 150
    assert (covered[hit] > 0.4).mean() > 0.99 and (covered[~hit] < 0.6).mean() > 0.999
    assert covered.sum() == pytest.approx(hit.sum(), rel=0.06)  # edges along rows of pixels: counting is coarse
    points = transform(scene.X_BV, scene.directions[hit] * depth[hit, None])
    local = np.abs((points - X[:3, 3]) @ X[:3, :3]) / HALF
    size = {Shape.BOX: local.max(axis=1), Shape.ELLIPSOID: np.linalg.norm(local, axis=1)}
    size[Shape.CYLINDER] = np.maximum(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    assert size[shape] == pytest.approx(np.ones(hit.sum()), abs=1e-6)
    to_camera = scene.X_BV[:3, 3] - points
    assert (np.einsum("ni,ni->n", normal[hit], to_camera) > 0).all()


def test_coverage_changes_as_it_says() -> None:
    square = np.array([[2.3, 2.4], [7.1, 2.4], [7.1, 6.8], [2.3, 6.8]])
    u, v = np.meshgrid(np.arange(10.0), np.arange(10.0))
    xy = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    near, share, change = coverage(square, xy)
    whole = np.zeros(100)
    whole[near] = share
    assert whole.sum() == pytest.approx(4.8 * 4.4, rel=0.03)
    shift = np.array([0.02, -0.03])
    near2, share2, _ = coverage(square + shift, xy)
    moved = np.zeros(100)
    moved[near2] = share2
    slope = np.zeros((100, 2))
    slope[near] = change
    same_side = np.abs(moved - whole) < 0.1
    assert (moved - whole)[same_side] == pytest.approx((slope @ shift)[same_side], abs=0.02)


def test_undistorted_pixels_project_back() -> None:
    scene, model = view(), close_up()
    points = np.array([[0.66, -0.03, 0.0], [0.70, 0.02, 0.02], [0.72, 0.04, 0.0]])
    pixels = project(model.colour, scene.X_VB, points)
    ideal = scene.image_point(points)
    for (u, v), expected in zip(pixels, ideal, strict=True):
        row, column = int(v) - scene.rows.start, int(u) - scene.columns.start
        corner, beside, below = scene.xy[row, column], scene.xy[row, column + 1], scene.xy[row + 1, column]
        got = corner + (u % 1) * (beside - corner) + (v % 1) * (below - corner)
        assert got == pytest.approx(expected, abs=0.01)


def test_an_area_that_the_camera_does_not_see_is_refused() -> None:
    with pytest.raises(ValueError, match="outside of the image"):
        view_of(close_up().colour, default_X_BC(), (0.6, 0.7, 0.9, 1.0), 0.02)
    with pytest.raises(ValueError, match="behind the camera"):
        view_of(close_up().colour, default_X_BC(), (2.4, 2.5, 0.0, 0.1), 0.02)
