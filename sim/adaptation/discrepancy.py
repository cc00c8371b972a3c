"""The discrepancy of reality from a simulator: a smooth function of the action, and of a context that moves things
(Kennedy & O'Hagan 2001).
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
"""Degrees of freedom of Student's t for residuals, so that one outlier does not outweigh all others."""

FEATURES = 256
"""Number of cosines in a drawn function."""


@dataclass(frozen=True)
class DiscrepancyScale:
    """Standard deviations of a discrepancy before any trial."""

    level: float  # the same for all actions
    local: float  # varies over `LENGTH`

    def times(self, factor: float) -> DiscrepancyScale:
        """The two scales, multiplied."""
        return DiscrepancyScale(self.level * factor, self.local * factor)

    def kernel(self, a: Array, b: Array) -> Array:
        """(A, d), (B, d) in fractions of ranges -> (A, B) covariances."""
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
        return np.asarray(self.level**2 + self.local**2 * np.exp(-0.5 * squared / LENGTH**2))


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """One discrepancy between reality and a simulator, conditioned on residuals: observations of trials minus
    predictions. A smooth function of the action, a Gaussian process (Kennedy & O'Hagan 2001).

    A misaligned mount, a bent blade or a tilted table has the same effect on similar actions. So a residual of a trial
    is expected of nearby actions too, and less so the farther away they are. See `Simulators.places`.

    Actions and noise of the trials are the same for every candidate simulator, so all are conditioned at once:
    Rasmussen & Williams 2006, eq. 2.30.
    """

    scale: DiscrepancyScale
    at: Array  # (N, d) `Simulators.places` of the trials
    noise: Array  # (N,) variance of each residual

    def evidence(self, residuals: Array) -> Array:
        """(N, K) residuals of K simulators -> (K,) log-evidence, up to a constant common to all scales."""
        if not len(self.at):
            return np.zeros(residuals.shape[1])
        volume = np.log(self._factor[0].diagonal()).sum()
        squared = (residuals * cho_solve(self._factor, residuals)).sum(axis=0)
        return np.asarray(-0.5 * (FREEDOM + len(self.at)) * np.log1p(squared / FREEDOM) - volume)

    def drawn(self, actions: Array, residuals: Array, seed: int) -> Array:
        """(A, d), (N, K) -> (A, K): one function drawn for each simulator; the same seed gives the same functions.

        A draw from the prior, corrected by its error at the trials (Wilson et al. 2020, eq. 13).
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


SUCCESS = DiscrepancyScale(level=0.1, local=0.25)
"""Prior scale of the discrepancy in the chance of success."""

END = DiscrepancyScale(level=0.1, local=0.15)
"""Prior scale of the discrepancy in the end state, in standard deviations of the end states in the ranges."""

FACTORS, FACTORS_STD = (0.5, 1.0, 2.0, 4.0), 1.0
"""Factors of the two scales are fitted to the trials; the second is the prior standard deviation of their logarithms.
"""

LEAST_CHANCE_STD, LEAST_END_STD = 0.22, 0.02
"""Noise of a single success and of a single end state, besides the disturbances."""
