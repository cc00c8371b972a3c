"""Do the rewards that were predicted before the trials say anything about those observed? Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from hw.types import Array

LEAST = 8
"""Fewer trials say too little about predictions."""

MISS = 0.2
"""An error below this leaves a choice between good and bad actions."""

MISSES = 0.25
"""Share of the predictions that miss. Fewer failures among many trials are chance, or are learnt from."""

NO_BETTER = 0.9
"""Predictions that err at least this share of the error of a constant carry no information by size."""

NO_ORDER = 0.5
"""A rank correlation below this carries none by order."""

STILL = 0.1
"""Errors of the latest iteration below this: whatever was wrong is over.

These were set in drawn worlds where no adapted session may be called uninformed, and in the same worlds with the
outcomes of other actions. Judged on fresh draws: docs/results/predictions.md.
"""


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

    @property
    def is_uninformed(self) -> bool:
        """Whether many predictions miss, no better than a constant, and in no order either; and not only earlier: those
        of the latest iteration are wrong as well.
        """
        is_ordered = self.rank_correlation is not None and self.rank_correlation >= NO_ORDER
        is_wrong = self.misses >= MISSES and self.error >= NO_BETTER * self.error_of_mean
        return self.trials >= LEAST and is_wrong and self.latest_error > STILL and not is_ordered


def prediction_quality(predicted: Array, observed: Array, latest: int = 1) -> PredictionQuality | None:
    """The quality for predicted and observed rewards (N,), the `latest` of them of the latest iteration.

    Trials without a prediction (nan) do not count. None below two.
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
    )
