"""Are the rewards observed in trials those that were predicted before them? A test of calibration, by betting. Pure.

A gambler bets against the claim "each reward is, in expectation, the predicted one". While the claim holds, the
expected capital never grows, so the chance that it ever reaches 1/alpha is at most alpha (Ville's inequality), for
rewards of any distribution on [0, 1], and even if one looks after every iteration. Waudby-Smith & Ramdas 2023, J. R.
Stat. Soc. B 86(1), with a null mean of its own for each trial. Rewards may be noisy: predictions need not name the
outcome, only its mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from hw.types import Array

ALPHA = 0.05
"""Chance that rewards with the predicted means ever refute the predictions."""

LEAST = 8
"""Fewer trials say too little about predictions."""

MISS = 0.2
"""With errors below this, predictions can still separate good from bad actions."""

MISSES = 0.25
"""Share of the predictions that miss. The method learns from fewer failures among many trials."""

NO_ORDER = 0.5
"""Predictions with at least this rank correlation still show which action is better."""

STILL = 0.1
"""If the errors of the latest iteration are below this, the predictions have recovered."""

STAKES, DEAREST = (0.5, 0.95), 6.0
"""Shares of the largest possible bet at stake, each with half of the capital, and the limit of that bet.

The larger share finds trials that all fail, the smaller one a mixture. The limit keeps a small error from refuting
predictions near 0 or 1."""

TOO_HIGH, TOO_LOW, DISORDERED = 0.6, 0.15, 0.25
"""Shares of the first capital that bet on lower rewards, on higher ones, and on the reverse order."""


@dataclass(frozen=True)
class PredictionQuality:
    """How the predicted rewards of some trials compare with the observed ones."""

    trials: int
    error: float  # root mean square of observed minus predicted
    error_of_mean: float  # the same for a constant, the mean of the other trials
    rank_correlation: float | None  # Spearman's; None if all predicted, or all observed, are alike
    bias: float  # mean of observed minus predicted
    latest_error: float  # root mean square, of the latest iteration alone
    misses: float  # share of the trials whose prediction was off by more than `MISS`
    capital: float  # of the gambler who started with 1 and bet against the predictions

    @property
    def is_uninformed(self) -> bool:
        """Whether the predictions are refuted, many of them miss by much, and they do not rank the trials either. Those
        of the latest iteration must be wrong as well.
        """
        is_refuted = self.trials >= LEAST and self.capital >= 1.0 / ALPHA
        is_ordered = self.rank_correlation is not None and self.rank_correlation >= NO_ORDER
        return is_refuted and self.misses >= MISSES and self.latest_error > STILL and not is_ordered


def capital_against(predicted: Array, observed: Array) -> float:
    """The capital of the gambler after all trials: predicted and observed rewards (N,) in [0, 1], in their order."""
    mean_so_far = np.cumsum(predicted) / np.arange(1, len(predicted) + 1)
    total = 0.0
    for share, side in (
        (TOO_HIGH, np.full(len(predicted), -1.0)),
        (TOO_LOW, np.full(len(predicted), 1.0)),
        (DISORDERED, -np.sign(predicted - mean_so_far)),
    ):
        most_lost = np.where(side < 0.0, 1.0 - predicted, predicted)  # if the reward is 1, or 0
        largest = side * np.minimum(1.0 / np.maximum(most_lost, 1e-9), DEAREST)
        after = [np.prod(1.0 + stake * largest * (observed - predicted)) for stake in STAKES]
        total += share * float(np.mean(after))
    return total


def prediction_quality(predicted: Array, observed: Array, latest: int = 1) -> PredictionQuality | None:
    """The quality for predicted and observed rewards (N,). The last `latest` ones are from the latest iteration.

    Trials without a prediction (nan) do not count. None for fewer than two trials.
    """
    has_prediction = np.isfinite(predicted)
    predicted, observed = np.asarray(predicted)[has_prediction], np.asarray(observed)[has_prediction]
    n = len(observed)
    if n < 2:
        return None
    off = observed - predicted
    apart = (observed - observed.mean()) * n / (n - 1)
    ranks = np.array([rankdata(predicted), rankdata(observed)])
    is_flat = bool((np.ptp(ranks, axis=1) == 0.0).any())
    return PredictionQuality(
        trials=n,
        error=float(np.sqrt((off**2).mean())),
        error_of_mean=float(np.sqrt((apart**2).mean())),
        rank_correlation=None if is_flat else float(np.corrcoef(ranks)[0, 1]),
        bias=float(off.mean()),
        latest_error=float(np.sqrt((off[-latest:] ** 2).mean())),
        misses=float((np.abs(off) > MISS).mean()),
        capital=capital_against(np.clip(predicted, 0.0, 1.0), np.clip(observed, 0.0, 1.0)),
    )
