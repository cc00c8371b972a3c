"""What reality adds to the simulator: a smooth function of the action, a Gaussian process (Kennedy & O'Hagan 2001).

A mount that is off, a blade that bends or a table that is not level do the same to neighbouring actions. So what the
trials showed beyond the simulator is expected of actions nearby as well, and the less the farther away they lie.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from hw.types import Array

LENGTH = 0.3
"""Distance, in fractions of the actions' ranges, over which a discrepancy varies."""


FREEDOM = 4.0
"""Of Student's t, by which residuals count: one that nothing explains does not outweigh all the others."""

FEATURES = 256
"""Cosines that a drawn function is made of."""


@dataclass(frozen=True)
class Scale:
    """Standard deviations of a discrepancy before any trial."""

    level: float  # the same for all actions
    local: float  # varies over `LENGTH`

    def times(self, factor: float) -> Scale:
        """Both, multiplied."""
        return Scale(self.level * factor, self.local * factor)

    def kernel(self, a: Array, b: Array) -> Array:
        """(A, d), (B, d) in fractions of ranges -> (A, B) covariances."""
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
        return np.asarray(self.level**2 + self.local**2 * np.exp(-0.5 * squared / LENGTH**2))


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """What is known of one discrepancy from residuals: what trials showed minus what one simulator predicts.

    Where the trials were and how noisy they are is the same for every simulator that may be true, so all are
    conditioned at once: Rasmussen & Williams 2006, eq. 2.30.
    """

    scale: Scale
    at: Array  # (N, d) actions in fractions of their ranges
    noise: Array  # (N,) variance of each residual

    def evidence(self, residuals: Array) -> Array:
        """(N, K) residuals of K simulators -> (K,) log-evidence, up to a constant that scales share."""
        if not len(self.at):
            return np.zeros(residuals.shape[1])
        volume = np.log(self._factor[0].diagonal()).sum()
        squared = (residuals * cho_solve(self._factor, residuals)).sum(axis=0)
        return np.asarray(-0.5 * (FREEDOM + len(self.at)) * np.log1p(squared / FREEDOM) - volume)

    def drawn(self, actions: Array, residuals: Array, seed: int) -> Array:
        """(A, d), (N, K) -> (A, K): a function drawn for each simulator; for the same seed always the same functions.

        A draw from before the trials, corrected by what it misses of them (Wilson et al. 2020, eq. 13).
        """
        rng, k = np.random.default_rng(seed), residuals.shape[1]
        weights, d = rng.standard_normal((1 + FEATURES, k)), actions.shape[1]
        waves, phases = rng.standard_normal((d, FEATURES)) / LENGTH, 2.0 * np.pi * rng.random(FEATURES)

        def before(at: Array) -> Array:
            local = np.cos(at @ waves + phases) * (2.0 / FEATURES) ** 0.5  # Rahimi & Recht 2007
            return np.asarray(self.scale.level * weights[0] + self.scale.local * local @ weights[1:])

        if not len(self.at):
            return before(actions)
        error = self.noise[:, None] ** 0.5 * rng.standard_normal((len(self.at), k))
        missed = residuals - before(self.at) - error
        return np.asarray(before(actions) + self.scale.kernel(actions, self.at) @ cho_solve(self._factor, missed))

    @cached_property
    def _factor(self) -> tuple[Array, bool]:
        factor: tuple[Array, bool] = cho_factor(self.scale.kernel(self.at, self.at) + np.diag(self.noise))
        return factor
