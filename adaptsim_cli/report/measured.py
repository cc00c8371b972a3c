"""Measured rewards, and the uncertainty of their mean."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.tasks import TASKS, get_task

Z95 = 1.96
"""Half width of the central 95 % of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Measured:
    """The mean reward of trials with its 95 % interval, clipped to the possible rewards."""

    mean: float
    low: float
    high: float
    trials: int


UNKNOWN_STD = 0.4
"""Standard deviation of single rewards for a task that this version does not know: almost that of a coin."""


def trial_std(task: str) -> float:
    """Standard deviation of the rewards of single trials of a task."""
    return get_task(task).adaptation.trial_std if task in TASKS else UNKNOWN_STD


def mean_of(rewards: Sequence[float], std: float) -> Measured:
    """The mean of single trials with standard deviation `std`. Raises ValueError without a trial."""
    if not rewards:
        raise ValueError("no trial, so no mean")
    mean = float(np.mean(rewards))
    half = Z95 * max(std, float(np.std(rewards, ddof=1)) if len(rewards) > 1 else 0.0) / math.sqrt(len(rewards))
    return Measured(mean, max(0.0, mean - half), min(1.0, mean + half), len(rewards))
