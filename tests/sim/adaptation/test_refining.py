"""Points are added where the likelihood is, and their weights are those of the posterior."""

import numpy as np
import pytest

from sim.adaptation.densities import Prior
from sim.adaptation.descent import descend
from sim.adaptation.refining import RESOLVED, refined
from sim.rollouts.draws import sobol

BOX = Prior.uniform(3)


@pytest.mark.parametrize("std", [0.1, 0.01, 0.001])
def test_a_normal_likelihood_gives_its_mean_and_width(std):
    centre = np.array([0.3, 0.62, 0.5])

    def log_likelihood(points):
        return -0.5 * (((points - centre) / std) ** 2).sum(axis=1)

    cloud = sobol(512, 3, np.random.default_rng(0))
    fit = refined(log_likelihood, cloud, log_likelihood(cloud), BOX, drawn=256, most=12)
    mean = fit.weights @ fit.points
    assert 1.0 / (fit.weights**2).sum() >= RESOLVED
    assert np.abs(mean - centre).max() < 0.4 * std
    assert np.sqrt(fit.weights @ (fit.points - mean) ** 2) == pytest.approx(np.full(3, std), rel=0.3)


def test_no_weight_lies_outside_the_box():
    def log_likelihood(points):
        return -0.5 * (((points - [0.0, 0.5, 1.0]) / 0.02) ** 2).sum(axis=1)

    cloud = sobol(512, 3, np.random.default_rng(0))
    fit = refined(log_likelihood, cloud, log_likelihood(cloud), BOX, drawn=256, most=12)
    outside = ((fit.points < 0.0) | (fit.points > 1.0)).any(axis=1)
    assert outside.any()
    assert fit.weights[outside].max() == 0.0
    assert fit.weights @ fit.points[:, 0] == pytest.approx(0.016, abs=0.005), "half of a normal density"


def test_a_wide_likelihood_needs_no_more_points():
    cloud = sobol(512, 3, np.random.default_rng(0))
    assert len(refined(lambda points: -points[:, 0], cloud, -cloud[:, 0], BOX, 256, 12).points) == 512


def test_least_squares_from_several_starts_ends_at_the_least_and_inside_the_box():
    def residuals(points):
        return np.stack([10.0 * (points[:, 1] - points[:, 0] ** 2), 1.0 - points[:, 0]], axis=1)  # Rosenbrock's valley

    starts = np.array([[-1.2, 1.0], [0.0, 0.0]])
    points, left = descend(residuals, starts, (np.full(2, -2.0), np.full(2, 2.0)))
    assert points == pytest.approx(np.ones((2, 2)), abs=1e-4)
    assert left.max() < 1e-8
    inside, _ = descend(residuals, starts, (np.full(2, -2.0), np.full(2, 0.5)))
    assert inside.max() <= 0.5
