import math

import numpy as np
import pytest

from sim.research.pretraining.verification.statistics import clustered, rank_correlation, reliability, spearman, wilson


def test_the_interval_of_clusters_covers_the_mean():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(60):
        estimate = clustered(rng.normal(0.3, 1.0, 30), rng)
        assert estimate.low < estimate.mean < estimate.high
        covered += estimate.low < 0.3 < estimate.high
    assert 51 <= covered <= 60


def test_wilson_agrees_with_published_values_and_says_nothing_without_data():
    low, high = wilson(np.array([0, 5, 10, 0]), np.array([10, 10, 10, 0]))
    assert low[:3] == pytest.approx([0.0, 0.2366, 0.7225], abs=1e-4)
    assert high[:3] == pytest.approx([0.2775, 0.7634, 1.0], abs=1e-4)
    assert math.isnan(low[3])


def test_reliability_is_the_share_of_variance_that_is_not_noise():
    rng = np.random.default_rng(0)
    truth, common = rng.normal(0.0, 0.2, (400, 1)), rng.normal(0.0, 3.0, 8)
    rewards = truth + common + rng.normal(0.0, 0.4, (400, 8))  # what all have in common does not count
    assert reliability(rewards) == pytest.approx(0.04 / (0.04 + 0.16 / 8), abs=0.04)
    assert reliability(common + rng.normal(0.0, 0.4, (400, 8))) < 0.15
    assert reliability(np.full((5, 3), 0.5)) == 0.0
    few = [reliability(noisy(rng, rng.normal(0.0, 0.2, (13, 1)), 10)[:, 0]) for _ in range(400)]
    assert np.mean(few) == pytest.approx(0.04 / (0.04 + 0.16 / 10), abs=0.03)  # no bias for few policies


def test_spearman_sees_order_alone():
    x = np.array([0.1, 0.4, 0.2, 0.9])
    assert spearman(x, np.exp(5 * x)) == pytest.approx(1.0)
    assert spearman(x, -x) == pytest.approx(-1.0)
    assert spearman(x, np.full(4, 0.3)) == 0.0
    assert spearman(np.array([1.0, 2.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(0.9487, abs=1e-4)


def noisy(rng, truth, rollouts, std=0.4):
    return truth[:, :, None] + rng.normal(0.0, std, (*truth.shape, rollouts))


def test_a_perfect_predictor_reaches_the_ceiling_and_a_poor_one_does_not():
    rng = np.random.default_rng(0)
    ratios, poor, inside = [], [], 0
    for _ in range(30):
        truth = rng.normal(0.5, 0.2, (13, 4))
        rewards = noisy(rng, truth, 10)
        found = rank_correlation(truth, rewards, rng)
        ratios.append(found.ratio)
        inside += found.perfect.low <= found.mean <= found.perfect.high
        poor.append(rank_correlation(truth + rng.normal(0.0, 0.3, truth.shape), rewards, rng).ratio)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert inside >= 26
    assert np.mean(poor) < 0.75


def test_rewards_that_do_not_differ_cannot_be_ranked():
    rng = np.random.default_rng(0)
    found = rank_correlation(rng.random((13, 4)), noisy(rng, np.full((13, 4), 0.5), 10), rng)
    assert math.isnan(found.ratio)
    assert found.chance > 0.05
