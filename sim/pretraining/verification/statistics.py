"""Intervals and correlations of the report on Phase 1. Pure; every draw comes from the caller's generator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.types import Array

BOOTSTRAPS = 4000
SIGNIFICANT = 0.05
"""Where chance makes rewards that are all the same differ like this more often, there is nothing to rank."""


@dataclass(frozen=True)
class Estimate:
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class RankCorrelation:
    """How well predictions order rewards that are known from a few rollouts only."""

    observed: Array  # (t,) of each target
    ceiling: Array  # (t,) what a perfect predictor reaches on average
    mean: float  # of the observed
    perfect: Estimate  # the same mean for a perfect predictor: its average, and where it lies in 95 % of all cases
    chance: float  # probability that rewards which are all the same in a target differ like this

    @property
    def ratio(self) -> float:
        """Observed against the ceiling; not a number where the rewards differ too little to be ranked."""
        return self.mean / self.perfect.mean if self.chance < SIGNIFICANT else math.nan


def clustered(values: Array, rng: np.random.Generator) -> Estimate:
    """Mean of clusters' means (n,) with a bootstrap over the clusters."""
    means = values[rng.integers(len(values), size=(BOOTSTRAPS, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Estimate(float(values.mean()), float(low), float(high))


def wilson(successes: NDArray[np.int_], counts: NDArray[np.int_]) -> tuple[Array, Array]:
    """(low, high) of the 95 % score intervals of shares (E. B. Wilson 1927); not a number where the count is 0."""
    z = 1.959964
    n = np.where(counts > 0, counts, np.nan)
    share = successes / n
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return middle - half, middle + half


def rank_correlation(expected: Array, rewards: Array, rng: np.random.Generator) -> RankCorrelation:
    """Predictions (n, t) of n policies in t targets against rewards (n, t, r) of r rollouts each.

    In each target rollout k of all policies met the same conditions. The ceiling comes from simulating a perfect
    predictor: true rewards and noise with the spread that the rollouts show, ranked over n policies.
    """
    from scipy.stats import f  # noqa: PLC0415 - slow to import

    (n, targets, r), true = rewards.shape, rewards.mean(axis=2)
    observed = np.array([spearman(expected[:, j], true[:, j]) for j in range(targets)])
    drawn = np.stack([_perfect(reliability(rewards[:, j]), n, rng) for j in range(targets)])
    means = drawn.mean(axis=0)
    low, high = np.quantile(means, [0.025, 0.975])
    between, within = np.sum([_mean_squares(rewards[:, j]) for j in range(targets)], axis=0)
    ratio = between / max(within, 1e-12)
    return RankCorrelation(
        observed=observed,
        ceiling=drawn.mean(axis=1),
        mean=float(observed.mean()),
        perfect=Estimate(float(means.mean()), float(low), float(high)),
        chance=float(f.sf(ratio, targets * (n - 1), targets * (n - 1) * (r - 1))),
    )


def reliability(rewards: Array) -> float:
    """Share of the variance of mean rewards over n > 3 policies, given (n, r), that is not the noise of the r rollouts.

    As Cronbach's alpha, the mean of all split halves, but without its bias for few policies; 0 to 1.
    """
    between, within = _mean_squares(rewards)
    n = len(rewards)
    return float(np.clip(1.0 - (n - 3) / (n - 1) * within / between, 0.0, 1.0)) if between > 1e-12 else 0.0


def _mean_squares(rewards: Array) -> tuple[float, float]:
    """Between n policies and within them, of (n, r) rewards; what all have in common in a rollout does not count."""
    n, r = rewards.shape
    own = rewards.mean(axis=1)
    residual = rewards - own[:, None] - rewards.mean(axis=0) + rewards.mean()
    return r * float(own.var(ddof=1)), float((residual**2).sum()) / ((n - 1) * (r - 1))


def spearman(x: Array, y: Array) -> float:
    """Rank correlation, ties in the middle; 0 where one of them is constant."""
    from scipy.stats import rankdata  # noqa: PLC0415 - slow to import

    ranks = rankdata(x), rankdata(y)
    if min(np.ptp(r) for r in ranks) == 0.0:
        return 0.0
    return float(np.corrcoef(*ranks)[0, 1])


def _perfect(reliable: float, n: int, rng: np.random.Generator) -> Array:
    """(BOOTSTRAPS,) rank correlations over n of a predictor that knows the truth with the truth and its noise."""
    truth = rng.standard_normal((BOOTSTRAPS, n))
    noisy = math.sqrt(reliable) * truth + math.sqrt(1.0 - reliable) * rng.standard_normal((BOOTSTRAPS, n))
    ranks = [np.argsort(np.argsort(v, axis=1), axis=1) - (n - 1) / 2 for v in (truth, noisy)]
    return np.asarray((ranks[0] * ranks[1]).sum(axis=1) / (n * (n**2 - 1) / 12))
