"""Measured rewards with their intervals, and how reliable the predictions before the trials were."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from adaptsim_cli.screen.views import between, signed
from adaptsim_cli.session.judgement import Z95, Prediction, end_error
from adaptsim_cli.session.records import TrialRecord
from sim.adaptation.predictions import LEAST, PredictionQuality, prediction_quality

BELIEVED = 0.05
"""A bias of the predicted reward below this is not worth mentioning."""


@dataclass(frozen=True)
class AgreementRow:
    """One trial: the reward that was predicted before it, and the observed one."""

    trial: int
    predicted: float
    low: float
    high: float
    observed: float
    before: float | None  # error of the predicted end, for the parameters of its policy; None without a checkpoint
    after: float | None  # the same for parameters drawn from the posterior, which knows the trial

    @property
    def is_inside(self) -> bool:
        """Whether the reward lies within the interval; half a hundredth of rounding counts as inside."""
        return self.low - 0.005 <= self.observed <= self.high + 0.005


@dataclass(frozen=True)
class Agreement:
    """All trials of a session."""

    rows: tuple[AgreementRow, ...]
    bias: float  # mean of observed minus predicted
    bias_low: float  # 95 % interval of it
    bias_high: float
    unit: str  # of the errors: "mm" on the table, else that of the observed quantities
    quality: PredictionQuality | None  # from the second iteration on; None below two trials

    @property
    def order_in_words(self) -> str:
        """Whether the predictions rank the trials correctly, in one sentence; "" if there are too few trials."""
        if self.quality is None or self.quality.trials < LEAST:
            return ""
        rank = self.quality.rank_correlation
        order = "all predicted or all observed are alike" if rank is None else signed(rank)
        return (
            f"From the second iteration on the predictions missed by {self.quality.error:.2f} (root mean square; the "
            f"mean of the rewards would miss by {self.quality.error_of_mean:.2f}); rank correlation: {order}."
        )

    @property
    def bias_in_words(self) -> str:
        """By how much the trials earned more or less than predicted, in one sentence."""
        if round(abs(self.bias), 2) == 0.0:
            return "On average the trials earned what was predicted."
        off = f"{abs(self.bias):.2f} {'more' if self.bias > 0.0 else 'less'} than predicted"
        ends = between(self.bias_low, self.bias_high, "+.2f")
        return f"On average a trial earned {off} (95 % interval of this difference: {ends})."

    @property
    def inside(self) -> int:
        """Trials whose reward lies within the interval."""
        return sum(row.is_inside for row in self.rows)

    @property
    def in_words(self) -> str:
        """Whether to believe the predictions, in one sentence."""
        if self.bias_low > BELIEVED:
            return "The simulator is too pessimistic: trials earn more than it predicts."
        if self.bias_high < -BELIEVED:
            return "Do not believe the predicted rewards: trials earn less than the simulator predicts."
        if self.bias_high - self.bias_low > 8 * BELIEVED:
            return "There are too few trials to say whether the predicted rewards can be believed."
        return "The predicted rewards show no clear bias."

    def median(self, which: str) -> float | None:
        """Median of the errors `before` or `after`; None if there are none."""
        values = [value for row in self.rows if (value := getattr(row, which)) is not None]
        return float(np.median(values)) if values else None


def agreement(
    trials: Sequence[TrialRecord], predictions: Mapping[int, Prediction] | None, unit: str, std: float
) -> Agreement | None:
    """The agreement of trials with their predictions; None without a trial. `std` is the standard deviation of single
    trials.
    """
    if not trials:
        return None
    rows = tuple(_row(trial, predictions[trial.trial] if predictions else None, unit) for trial in trials)
    off = np.array([row.observed - row.predicted for row in rows])
    half = Z95 * max(std, float(off.std(ddof=1)) if len(off) > 1 else 0.0) / len(off) ** 0.5
    bias = float(off.mean())
    later = [trial for trial in trials if trial.iteration > 1]
    predicted, observed = np.array([[trial.predicted_reward, trial.reward] for trial in later]).reshape(-1, 2).T
    return Agreement(rows, bias, bias - half, bias + half, unit, prediction_quality(predicted, observed))


def _row(trial: TrialRecord, prediction: Prediction | None, unit: str) -> AgreementRow:
    before = after = None
    if prediction is not None:
        end = trial.track.track().at(prediction.t_s[-1:])[0, list(prediction.columns)]
        before = end_error(end, prediction.guess[-1:], unit)
        after = end_error(end, prediction.likely[:, -1], unit)
    return AgreementRow(
        trial.trial, trial.predicted_reward, trial.predicted_low, trial.predicted_high, trial.reward, before, after
    )
