"""Bets on a difference of paired rewards that aim at a planned number of pairs. Pure.

A gambler who may look forever bets carefully. One who knows that the comparison ends after N pairs chooses each stake
so that the chance of reaching the goal by then is largest (dynamic programming over capital and pairs left). It needs a
difference to plan for: a success rate of `HIGH` instead of `LOW`. The validity does not depend on this plan. As long as
the expected difference is not positive, whatever the past, the capital never grows in expectation (Ville's inequality).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from hw.types import Array

HIGH, LOW = 0.92, 0.72
"""Success rates of the difference that the bets are planned for."""

GRID = 400
"""Steps from no capital to the goal."""


def planned_capital(differences: Array, pairs: int, start: float) -> Array:
    """(..., n) the capital after each pair, as a multiple of the first capital; `start` is the first capital as a share
    of the goal.

    `differences` (..., n) lie in [-1, 1]. At the goal, and after `pairs` pairs, the betting ends.
    """
    stakes, grid = _stakes(pairs), np.arange(GRID + 1) / GRID
    capital = np.full(differences.shape[:-1], start)
    after = np.empty(differences.shape)
    for k in range(differences.shape[-1]):
        if k < pairs:
            stake = np.minimum(np.interp(capital, grid, stakes[pairs - k - 1]), capital)
            capital = capital + np.where(capital >= 1.0 - 1e-9, 0.0, stake) * differences[..., k]
        after[..., k] = capital / start
    return after


@cache
def _stakes(pairs: int) -> Array:
    """(pairs, GRID + 1) the best stake with 1, 2, ... pairs left, for each capital; both as shares of the goal."""
    up, down = HIGH * (1.0 - LOW), LOW * (1.0 - HIGH)
    capital, stake = np.arange(GRID + 1), np.arange(GRID // 2 + 1)
    more, less = np.minimum(capital[:, None] + stake, GRID), np.maximum(capital[:, None] - stake, 0)
    is_possible = (stake <= capital[:, None]) & (stake <= GRID - capital[:, None])
    chance, best = (capital == GRID).astype(np.float64), list[NDArray[np.intp]]()
    for _ in range(pairs):
        reached = up * chance[more] + down * chance[less] + (1.0 - up - down) * chance[:, None]
        best.append(np.where(is_possible, reached, -1.0).argmax(axis=1))
        chance = reached[capital, best[-1]]
    return np.array(best).reshape(pairs, GRID + 1) / GRID
