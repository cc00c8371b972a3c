"""Intervals and correlations for the report on Phase 1. Pure; all draws come from the caller's generator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.types import Estimate

BOOTSTRAPS = 4000
SIGNIFICANT = 0.05
"""If equal true rewards would differ like this with a higher probability, there is nothing to rank."""


@dataclass(frozen=True, eq=False)
class RankCorrelation:
    """How well predictions rank rewards that are known from only a few rollouts."""

    observed: Array  # (t,) per target
    ceiling: Array  # (t,) mean of a perfect predictor
    mean: float  # of `observed`
    perfect: Estimate  # the same mean for a perfect predictor: its average and 95 % interval
    chance: float  # probability that equal true rewards in a target differ like this

    @property
    def ratio(self) -> float:
        """Observed mean over the ceiling; nan if the rewards differ too little to be ranked."""
        return self.mean / self.perfect.mean if self.chance < SIGNIFICANT else math.nan


def clustered(values: Array, rng: np.random.Generator) -> Estimate:
    """Mean of cluster means (n,) with a bootstrap over clusters."""
    means = values[rng.integers(len(values), size=(BOOTSTRAPS, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Estimate(float(values.mean()), float(low), float(high))


def wilson(successes: NDArray[np.int_], counts: NDArray[np.int_]) -> tuple[Array, Array]:
    """(low, high) of the 95 % score intervals of shares (E. B. Wilson 1927); nan if the count is 0."""
    z = 1.959964
    n = np.where(counts > 0, counts, np.nan)
    share = successes / n
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return middle - half, middle + half


def rank_correlation(expected: Array, rewards: Array, rng: np.random.Generator) -> RankCorrelation:
    """Predictions (n, t) of n policies in t targets against rewards (n, t, r) of r rollouts each.

    In each target, rollout k of all policies had the same conditions. The ceiling comes from simulating a perfect
    predictor: true rewards and noise with the spread of the rollouts, ranked over n policies.
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
    """Share of the variance of mean rewards over n > 3 policies, from (n, r), that is not noise of the r rollouts.

    As Cronbach's alpha, the mean of all split halves, but without its bias for few policies; 0 to 1.
    """
    between, within = _mean_squares(rewards)
    n = len(rewards)
    return float(np.clip(1.0 - (n - 3) / (n - 1) * within / between, 0.0, 1.0)) if between > 1e-12 else 0.0


def _mean_squares(rewards: Array) -> tuple[float, float]:
    """Mean squares between and within n policies, of (n, r) rewards, without the common effect of each rollout."""
    n, r = rewards.shape
    own = rewards.mean(axis=1)
    residual = rewards - own[:, None] - rewards.mean(axis=0) + rewards.mean()
    return r * float(own.var(ddof=1)), float((residual**2).sum()) / ((n - 1) * (r - 1))


def spearman(x: Array, y: Array) -> float:
    """Rank correlation with mean ranks for ties; 0 if one of them is constant."""
    from scipy.stats import rankdata  # noqa: PLC0415 - slow to import

    ranks = rankdata(x), rankdata(y)
    if min(np.ptp(r) for r in ranks) == 0.0:
        return 0.0
    return float(np.corrcoef(*ranks)[0, 1])


def _perfect(reliable: float, n: int, rng: np.random.Generator) -> Array:
    """(BOOTSTRAPS,) rank correlations over n between the truth and the truth plus noise."""
    truth = rng.standard_normal((BOOTSTRAPS, n))
    noisy = math.sqrt(reliable) * truth + math.sqrt(1.0 - reliable) * rng.standard_normal((BOOTSTRAPS, n))
    ranks = [np.argsort(np.argsort(v, axis=1), axis=1) - (n - 1) / 2 for v in (truth, noisy)]
    return np.asarray((ranks[0] * ranks[1]).sum(axis=1) / (n * (n**2 - 1) / 12))
