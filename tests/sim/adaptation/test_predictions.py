"""Whether predictions say anything about trials, and when the verdict says that they do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr

from hw.types import Array
from sim.adaptation.predictions import ALPHA, LEAST, PredictionQuality, prediction_quality


def quality(predicted: Sequence[float] | Array, observed: Sequence[float] | Array) -> PredictionQuality:
    measured = prediction_quality(np.asarray(predicted, float), np.asarray(observed, float), 4)
    assert measured is not None
    return measured


def test_the_figures_are_those_of_the_field() -> None:
    rng = np.random.default_rng(0)
    predicted, observed = rng.random(12), np.round(rng.random(12), 1)  # with ties
    measured = quality(predicted, observed)
    assert measured.rank_correlation == pytest.approx(spearmanr(predicted, observed).statistic)
    assert measured.error == pytest.approx(np.sqrt(np.mean((predicted - observed) ** 2)))
    others = [np.delete(observed, i).mean() for i in range(12)]
    assert measured.error_of_mean == pytest.approx(np.sqrt(np.mean((np.array(others) - observed) ** 2)))
    assert measured.bias == pytest.approx(np.mean(observed - predicted))


def test_trials_without_a_prediction_do_not_count() -> None:
    assert prediction_quality(np.array([np.nan, 0.5]), np.array([0.1, 0.2])) is None
    assert quality([np.nan, 0.5, 0.6], [0.1, 0.2, 0.3]).trials == 2


def test_all_alike_have_no_order() -> None:
    assert quality([0.9] * 5, [0.1, 0.5, 0.9, 0.2, 0.3]).rank_correlation is None


@pytest.mark.parametrize(
    ("predicted", "observed", "is_uninformed"),
    [
        ([0.9] * 10, [0.92, 0.88] * 5, False),  # right, and all alike
        ([0.8] * 10, [0.0, 0.55] * 5, True),  # a coin
        ([0.8] * 16, [0.85] * 12 + [0.0] + [0.85] * 3, False),  # one failure
        ([0.9, 0.2] * 5, [0.9, 0.1] * 5, False),  # right, and different
        ([0.9, 0.5] * 5, [0.6, 0.0] * 5, False),  # too high, in the right order
        ([0.9, 0.2] * 5, [0.1, 0.9] * 5, True),  # in the wrong order
        ([0.95] * 10, [0.8] * 10, False),  # a little too high
        ([0.95] * 10, [0.3] * 10, True),  # much too high
        ([0.8] * 10, [0.0, 0.9] * 3 + [0.85, 0.8, 0.85, 0.8], False),  # wrong only earlier
        ([0.8] * (LEAST - 1), [0.0, 0.9, 0.0, 0.9, 0.0, 0.9, 0.0], False),  # too few
    ],
)
def test_predictions_are_uninformed_if_refuted_wrong_by_much_and_out_of_order(
    predicted: list[float], observed: list[float], is_uninformed: bool
) -> None:
    assert quality(predicted, observed).is_uninformed is is_uninformed


def test_good_predictions_of_noisy_trials_are_hardly_ever_called_so() -> None:
    """Outcomes drawn from their predicted chances, which differ: over 2,000 sessions of 16 trials."""
    rng, called = np.random.default_rng(1), 0
    for _ in range(2000):
        chances = rng.choice([0.05, 0.95], 16)
        called += quality(chances, (rng.random(16) < chances).astype(float)).is_uninformed
    assert called / 2000 < 0.02


@pytest.mark.parametrize("chance", [0.3, 0.5, 0.7, 0.8, 0.9, 0.95])
def test_perfect_predictions_are_refuted_in_at_most_one_session_of_twenty(chance: float) -> None:
    """Success is drawn with exactly the predicted chance; looked at after 8, 12 and 16 trials."""
    rng, called = np.random.default_rng(6), 0
    for _ in range(500):
        predicted = np.clip(chance + 0.05 * rng.standard_normal(16), 0.01, 0.99)
        observed = (rng.random(16) < predicted).astype(float)
        called += any(quality(predicted[:n], observed[:n]).is_uninformed for n in (8, 12, 16))
    assert called / 500 <= ALPHA


@pytest.mark.parametrize(("predicted", "chance"), [(0.8, 0.2), (0.9, 0.3), (0.3, 0.9)])
def test_wrong_chances_are_found_in_most_sessions(predicted: float, chance: float) -> None:
    rng, called = np.random.default_rng(7), 0
    for _ in range(100):
        observed = (rng.random(16) < chance).astype(float)
        called += any(quality([predicted] * n, observed[:n]).is_uninformed for n in (8, 12, 16))
    assert called > 80


def test_a_reversed_order_is_found_although_the_mean_is_right() -> None:
    rng, called = np.random.default_rng(8), 0
    for _ in range(100):
        predicted = rng.choice([0.2, 0.8], 16)
        called += quality(predicted, (rng.random(16) < 1.0 - predicted).astype(float)).is_uninformed
    assert called > 80


def test_the_quality_changes_no_other_figure() -> None:
    measured = quality([0.8] * 10, [0.0, 0.9] * 5)
    assert not replace(measured, misses=0.2).is_uninformed
    assert not replace(measured, rank_correlation=0.6).is_uninformed
    assert not replace(measured, latest_error=0.05).is_uninformed
    assert not replace(measured, capital=19.0).is_uninformed
