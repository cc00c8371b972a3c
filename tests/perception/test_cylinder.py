"""Fits of cylinders to points with noise and strangers."""

from __future__ import annotations

import numpy as np
import pytest
from bottle_scenes import BODY, leaning

from hw.poses import inverse
from hw.types import Array
from perception.cylinder import distance_m, fit_circle, fit_pose, front_m, lowest_m, tilt_rad
from perception.geometry import transform


def arc(rng: np.random.Generator, centre: Array, radius_m: float, strangers: int = 0) -> Array:
    """Points of the half that faces a camera, with noise along its line of sight."""
    angle = rng.uniform(-np.pi / 2.2, np.pi / 2.2, 400)
    noise = np.c_[0.0015 * rng.standard_normal(400), np.zeros(400)]
    points = centre + radius_m * np.c_[np.cos(angle), np.sin(angle)] + noise
    return np.concatenate([points, centre + rng.uniform(-0.08, 0.08, (strangers, 2))])


def test_a_known_radius_gives_the_centre_among_strangers() -> None:
    rng = np.random.default_rng(0)
    centre = np.array([0.7, -0.1])
    circle = fit_circle(arc(rng, centre, 0.03, strangers=120), centre + np.array([0.015, 0.01]), 0.03)
    assert np.linalg.norm(circle.centre_m - centre) < 0.0005
    assert circle.share == pytest.approx(400 / 520, abs=0.08)


def test_an_unknown_radius_is_found_too() -> None:
    circle = fit_circle(arc(np.random.default_rng(1), np.zeros(2), 0.045), np.array([0.01, 0.0]), 0.04, 0.015)
    assert circle.radius_m == pytest.approx(0.045, abs=0.0007)
    assert circle.rms_m == pytest.approx(0.0012, abs=0.0004)


@pytest.mark.parametrize("tilt_deg", [0.0, 25.0, 60.0, 90.0])
def test_any_pose_is_recovered_from_the_visible_side(tilt_deg: float) -> None:
    rng = np.random.default_rng(2)
    X = leaning(np.array([0.7, 0.05]), np.deg2rad(tilt_deg), 0.7)
    eye = np.array([1.28, 0.0, 0.72])
    targets = X[:3, 3] + rng.uniform(-0.06, 0.06, (4000, 3))
    depth = front_m(targets - eye, eye, X, BODY)
    hit = np.isfinite(depth)
    points = eye + depth[hit, None] * (targets - eye)[hit]
    assert np.abs(distance_m(points, X, BODY)).max() < 1e-9
    noisy = points + 0.0015 * rng.standard_normal(points.shape)
    start = leaning(np.array([0.71, 0.04]), np.deg2rad(tilt_deg - 12), 0.6)
    found = fit_pose(noisy, start, BODY)
    assert np.linalg.norm(found[:3, 3] - X[:3, 3]) < 0.0015
    assert abs(np.rad2deg(tilt_rad(found)) - min(tilt_deg, 180 - tilt_deg)) < 2.0
    assert abs(lowest_m(found, BODY)) < 0.003


def test_distances_of_a_solid() -> None:
    X = leaning(np.array([0.5, 0.0]), 0.4)
    local = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0, 0.07], [0.033, 0, 0.054], [0.0, 0.02, 0.0]])
    found = distance_m(transform(X, local), X, BODY)
    assert found == pytest.approx([-0.03, 0.02, 0.02, 0.005, -0.01], abs=1e-9)
    assert np.allclose(inverse(X) @ X, np.eye(4))
