"""The likelihood of observed trajectories, by the simulator, for parameter vectors that may be the true ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from sim.adaptation.densities import Prior, weights_of
from sim.adaptation.method import Iteration, Trial
from sim.rollouts.draws import Disturbances, varies
from sim.solvers.misfit import log_likelihood, observed_share, squares
from sim.tasks.task import Expectations

DRAWS = 16
"""Draws of nuisance and action error, over which the likelihood of a trajectory is averaged."""


@dataclass(frozen=True, eq=False)
class TrajectoryLikelihood:
    """Log-likelihoods of trials, up to a constant. Those of `truths` are computed once for each trial."""

    expectations: Expectations
    truths: Array  # (T, p) in units, that follow the prior
    prior: Prior  # in fractions of the margin
    _of_truths: dict[bytes, Array] = field(default_factory=dict, repr=False)  # by trial

    def after_each(self, history: Sequence[Iteration]) -> list[Array]:
        """(T,) log-likelihoods of `truths` by all trajectories: before the first iteration, and after each."""
        log, sums = np.zeros(len(self.truths)), list[Array]()
        for iteration in ((), *history):
            for trial in (t for entry in iteration for t in entry.trials):
                if trial.key not in self._of_truths:
                    self._of_truths[trial.key] = self.of(trial, self.truths)
                log = log + self._of_truths[trial.key]
            sums.append(log)
        return sums

    def weights_after_each(self, history: Sequence[Iteration]) -> list[Array]:
        """(T,) probabilities of `truths`: before the first iteration, and after each."""
        return [weights_of(log) for log in self.after_each(history)]

    def of(self, trial: Trial, parameters: Array) -> Array:
        """(N,) log-likelihoods of a trial's trajectory for parameters (N, p) in units."""
        task = self.expectations.task
        draws = DRAWS if varies(task) else 1
        drawn = Disturbances.evenly(task, draws, np.random.default_rng(0))
        paths = self.expectations.trajectories(
            np.repeat(parameters, draws, axis=0),
            np.tile(trial.action + drawn.error, (len(parameters), 1)),
            np.tile(drawn.nuisance, (len(parameters), 1)),
            np.broadcast_to(trial.context, (len(parameters) * draws, len(task.context))),
        )
        squared = squares(self.expectations, trial.observation, paths)
        return log_likelihood(squared.reshape(len(parameters), draws), observed_share(trial.observation))
