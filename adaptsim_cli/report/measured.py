"""Rewards that were measured, and how sure their mean is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.tasks import TASKS, get_task

Z95 = 1.96
"""Standard deviations that hold 95 % of a normal distribution."""


@dataclass(frozen=True)
class Measured:
    """The mean of some trials' rewards with its 95 % interval, within the rewards there are."""

    mean: float
    low: float
    high: float
    trials: int


UNKNOWN_STD = 0.4
"""Of the rewards of single trials of a task that this version does not know: nearly that of a coin."""


def trial_std(task: str) -> float:
    """How much the rewards of single trials of a task spread."""
    return get_task(task).adaptation.trial_std if task in TASKS else UNKNOWN_STD


def mean_of(rewards: Sequence[float], std: float) -> Measured:
    """Of single trials that spread by `std`. Raises ValueError without a trial."""
    if not rewards:
        raise ValueError("no trial, so no mean")
    mean = float(np.mean(rewards))
    half = Z95 * max(std, float(np.std(rewards, ddof=1)) if len(rewards) > 1 else 0.0) / math.sqrt(len(rewards))
    return Measured(mean, max(0.0, mean - half), min(1.0, mean + half), len(rewards))
