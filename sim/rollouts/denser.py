"""The second part of a dataset: denser where the outcome is not yet known from the first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.rollouts.run import Requests

if TYPE_CHECKING:
    from sim.rollouts.dataset import Dataset

POOL = 4
"""Candidates for every rollout that is added."""

FLOOR = 0.02
"""Added to the variance of an outcome (at most .25), so that no region is left out."""


@dataclass(frozen=True)
class Denser:
    """How many rollouts are added, and what tells where."""

    count: int
    variance: Callable[[Dataset, Requests], Array]
    """(first part, candidates (N,)) -> (N,) variance of the outcome of each, by what the first part tells."""


def choose(variance: Array, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """`count` rows, ascending, drawn in proportion to the `variance` (N,) of their outcome."""
    weight = variance + FLOOR
    return np.sort(rng.choice(len(variance), count, replace=False, p=weight / weight.sum()))
