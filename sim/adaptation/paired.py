"""Tests by betting whether paired rewards differ. The result may be read after every pair. Pure.

A gambler bets against the claim "the mean difference is at most m". While the claim holds, the expected capital never
grows, so the chance that it ever reaches 1/alpha is at most alpha (Ville's inequality): one may look after every pair
and stop whenever one likes. Waudby-Smith & Ramdas 2023, "Estimating means of bounded random variables by betting",
J. R. Stat. Soc. B 86(1): the hedged capital of section 4, here with a mixture over fixed bets (their section 5.3 and
appendix B) instead of one bet that is chosen anew after each pair. For the question whether adapting helps, most of the
capital follows a plan for a number of pairs (`sim.adaptation.planned_bets`).

The differences may have any distribution on [-1, 1], and the next one may depend on all earlier ones. If policies
change from pair to pair, so does the expected difference. Then the lower end lies below the largest of them and the
upper end above the smallest, both with 95 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.planned_bets import HIGH, planned_capital

ALPHA = 0.05
"""Chance that the interval ever misses the mean difference."""

ALPHA_SHOWN = 0.04
"""The part of ALPHA that is spent on the lower end and on the claim of a gain, which is the question. The rest is spent
on the upper end."""

PAIRS = 60
"""Planned pairs, unless a session states another number."""

PLANNED = 0.7
"""Share of the first capital that bets by the plan."""

WORTH = 0.05
"""A smaller gain is not worth a session. The results use the same limit."""

BETS = np.array([0.9, 0.5, 0.25, 0.12, 0.06, 0.03])
"""Shares of the capital at stake. The largest shares show large differences early, and only the smallest find small
ones."""

SHARES = np.array([0.40, 0.30, 0.12, 0.08, 0.06, 0.04])
"""Shares of the first capital behind each bet."""

MOST_FURTHER = 100
"""The most further pairs that are considered."""

_FUTURES = 400
_STEPS = 30  # of a bisection over [-1, 1]: to 2e-9


class Claim(StrEnum):
    """The claim that the pairs so far allow."""

    SHOWN = "shown"  # better than the control
    WORSE = "worse"  # worse than the control
    NO_GAIN = "no gain"  # better by less than WORTH, if at all
    OPEN = "open"


@dataclass(frozen=True)
class PairedDifference:
    """The comparison by the pairs so far; all values are of rewards between 0 and 1."""

    pairs: int
    mean: float  # of the trials that are compared
    control_mean: float
    low: float  # of the difference, 95 %, valid at any time
    high: float
    claim: Claim
    decided_after: int | None  # pairs after which the claim was first allowed; None: it is open
    further: int | None  # pairs expected until it is shown; None: no longer open, or more than MOST_FURTHER

    @property
    def difference(self) -> float:
        """Mean difference of the pairs."""
        return self.mean - self.control_mean


def capital(differences: Array, mean: Array) -> Array:
    """(..., n) the capital after each pair of a gambler who bets that the expected difference exceeds `mean`.

    `differences` (..., n) lie in [-1, 1]; `mean` (...) in (-1, 1]. The capital starts with 1. Against the opposite
    claim: `capital(-differences, -mean)`.
    """
    return np.asarray(np.tensordot(SHARES, np.exp(_logs(differences, np.asarray(mean))), axes=1))


def _logs(differences: Array, mean: Array) -> Array:
    """(bets, ..., n) logarithm of the capital behind each bet, as a multiple of its first one."""
    bets = BETS.reshape(-1, *[1] * differences.ndim)
    each = (differences - mean[..., None]) / (1.0 + mean[..., None])
    return np.asarray(np.cumsum(np.log1p(bets * each), axis=-1))


def gain_capital(differences: Array, pairs: int = PAIRS) -> Array:
    """(..., n) the capital after each pair of a gambler who bets that the expected difference is positive, with a plan
    for `pairs` pairs. A gain is shown once it reaches 1 / ALPHA_SHOWN.
    """
    planned = planned_capital(differences, pairs, PLANNED * ALPHA_SHOWN)
    steady = capital(differences, np.zeros(differences.shape[:-1]))
    return np.asarray(PLANNED * planned + (1.0 - PLANNED) * steady)


def is_gain_shown(differences: Array, pairs: int = PAIRS) -> NDArray[np.bool_]:
    """(..., n) whether a gain is shown after each pair. Once it is shown, it stays shown."""
    reached = gain_capital(differences, pairs) >= (1.0 - 1e-9) / ALPHA_SHOWN
    return np.asarray(np.logical_or.accumulate(reached, axis=-1))


def ends(differences: Array, pairs: int = PAIRS) -> tuple[Array, Array]:
    """(..., n) lower and (..., n) upper end of the 95 % interval of the mean difference after each pair.

    Another pair never widens it. The lower end is at least 0 once a gain is shown.
    """
    low = _lower_ends(differences, (1.0 - PLANNED) * ALPHA_SHOWN)
    high = -_lower_ends(-differences, ALPHA - ALPHA_SHOWN)
    return np.where(is_gain_shown(differences, pairs), np.maximum(low, 0.0), low), high


def _lower_ends(differences: Array, alpha: float) -> Array:
    """(..., n) lower end of the interval that misses the mean difference with a chance of `alpha`."""
    low, high = np.full(differences.shape, -1.0), np.ones(differences.shape)
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        is_refuted = _capital_at_end(differences, middle) >= 1.0 / alpha
        low, high = np.where(is_refuted, middle, low), np.where(is_refuted, high, middle)
    return np.asarray(np.maximum.accumulate(low, axis=-1))


def _capital_at_end(differences: Array, means: Array) -> Array:
    """(..., n) the capital after pair i of a gambler who bet against `means` (..., n), entry i, from the start."""
    n = differences.shape[-1]
    logs = np.zeros((len(BETS), *differences.shape))
    bets = BETS.reshape(-1, *[1] * differences.ndim)
    for k in range(n):
        each = (differences[..., k, None] - means[..., k:]) / (1.0 + means[..., k:])
        logs[..., k:] += np.log1p(bets * each)
    return np.asarray(np.tensordot(SHARES, np.exp(logs), axes=1))


def compare(rewards: Array, control: Array, pairs: int = PAIRS) -> PairedDifference:
    """The claim that pairs of `rewards` (n,) and `control` (n,), both in [0, 1] and in the order of the trials, allow.

    `pairs` is the number that was planned before the first one.

    Raises ValueError without a pair, or for a reward outside [0, 1].
    """
    rewards, control = np.asarray(rewards, float), np.asarray(control, float)
    if rewards.shape != control.shape or rewards.ndim != 1 or not len(rewards):
        raise ValueError(f"rewards come in pairs, and there are {rewards.shape} and {control.shape} of them")
    if not ((np.minimum(rewards, control) >= 0.0) & (np.maximum(rewards, control) <= 1.0)).all():
        raise ValueError("a reward lies between 0 and 1")
    differences = rewards - control
    lows, highs = ends(differences, pairs)
    claim, after = _claimed(is_gain_shown(differences, pairs), highs)
    low, high = sorted((float(lows[-1]), float(highs[-1])))  # they cross only if the policies changed
    further = further_pairs(differences, pairs) if claim is Claim.OPEN else None
    mean, control_mean = float(rewards.mean()), float(control.mean())
    return PairedDifference(len(differences), mean, control_mean, low, high, claim, after, further)


def _claimed(is_shown: NDArray[np.bool_], highs: Array) -> tuple[Claim, int | None]:
    """The strongest claim, and the pairs after which it was first allowed."""
    for claim, allowed in ((Claim.SHOWN, is_shown), (Claim.WORSE, highs < 0.0), (Claim.NO_GAIN, highs < WORTH)):
        if allowed.any():
            return claim, int(np.argmax(allowed)) + 1
    return Claim.OPEN, None


def further_pairs(differences: Array, pairs: int = PAIRS) -> int | None:
    """Number of further pairs after which a gain is shown in half of the futures that repeat the `differences` (n,) so
    far.

    None: more than MOST_FURTHER, or fewer than two pairs so far.
    """
    if len(differences) < 2:
        return None
    rng = np.random.default_rng(0)
    drawn = rng.choice(differences, (_FUTURES, MOST_FURTHER))
    whole = np.concatenate([np.tile(differences, (_FUTURES, 1)), drawn], axis=1)
    is_shown = is_gain_shown(whole, pairs)[:, len(differences) :]
    first = np.where(is_shown.any(axis=1), is_shown.argmax(axis=1) + 1, MOST_FURTHER + 1)
    middle = int(np.median(first))
    return middle if middle <= MOST_FURTHER else None


def power(gain: float, pairs: int, planned: int | None = None) -> float:
    """Share of the comparisons that show a `gain` of the success rate, up to `HIGH`, within `pairs` pairs.

    `planned` pairs differ from `pairs` if a session ends before its plan does.
    """
    rng, sessions = np.random.default_rng(0), 2000
    mine, theirs = (rng.random((sessions, pairs)) < rate for rate in (HIGH, HIGH - gain))
    return float(is_gain_shown(mine * 1.0 - theirs * 1.0, planned or pairs)[:, -1].mean())
