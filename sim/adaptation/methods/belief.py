"""AdaptSim by inference: infers the true parameters from all trajectories, and the E that would earn most there.

The paper's adaptation policy learns from thousands of sessions in which direction to move E. An emulator that answers
in microseconds allows to ask the question directly, for all trials at once and without a fixed step:

1. Each trajectory weighs candidate parameters by how well the emulator explains it there.
2. The expected reward of an E is the mean of its prospects under these weights (`sim.adaptation.reward_table`).
3. No parameters describe the real object exactly. So this expectation is only the prior mean of a Gaussian process over
E, which the rewards of the trials correct. They change little if the simulator expresses the object; else they decide.

The first particle goes to the E with the largest expected reward, each other one to the E with the largest possible
gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, prospects_of
from sim.adaptation.method import Iteration, Particle, Trial
from sim.adaptation.reward_table import RewardTable
from sim.rollouts.draws import Disturbances, varies
from sim.solvers.misfit import log_likelihood, observed_share, squares
from sim.solvers.solver import Expectations
from sim.tasks.task import Task

DRAWS = 16
"""Draws of nuisance and action error, over which the likelihood of a trajectory is averaged."""

LEVEL_STD, REALITY_STD, LENGTH = 0.1, 0.15, 0.3
"""Standard deviations of real rewards from the simulator's: one for all E together, one that varies over E with the
length `LENGTH`, in fractions of the ranges.
"""


def create(task: Task, checkpoint: Checkpoint | None) -> Belief:
    """The method's entry in `METHODS`. Raises CheckpointError if the checkpoint has no parts for inference."""
    prospects = prospects_of("adaptsim-belief", task, checkpoint)
    assert checkpoint is not None  # it holds the prospects
    return Belief(checkpoint.solver, prospects)


@dataclass(frozen=True, eq=False)
class Belief:
    """A deterministic `Method` that uses all trials of the session."""

    expectations: Expectations
    prospects: RewardTable
    _known: dict[bytes, Array] = field(default_factory=dict, repr=False)  # log-likelihoods, by trial

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The E that earns most over all the truths there may be, and others that may earn more."""
        return self._best([], n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Deterministic; where the particles were before does not matter."""
        return self._best(history, len(history[-1]))

    def weights(self, history: Sequence[Iteration]) -> Array:
        """(T,) probabilities of the candidate truths of `prospects`, given the trajectories."""
        return self.weights_after_each(history)[-1]

    def weights_after_each(self, history: Sequence[Iteration]) -> list[Array]:
        """The weights before the first iteration, and after each."""
        likely = (np.exp(log - log.max()) for log in self.log_likelihoods_after_each(history))
        return [np.asarray(weights / weights.sum()) for weights in likely]

    def log_likelihoods_after_each(self, history: Sequence[Iteration]) -> list[Array]:
        """(T,) log-likelihoods of all trajectories up to a constant: before the first iteration, and after each."""
        log, sums = np.zeros(len(self.prospects.truths)), list[Array]()
        for iteration in ((), *history):
            for trial in (t for entry in iteration for t in entry.trials):
                log = log + self._log_likelihood(trial)
            sums.append(log)
        return sums

    def estimate(self, history: Sequence[Iteration]) -> tuple[Array, Array]:
        """(C,) mean and (C,) standard deviation of the real reward of each candidate E: Rasmussen & Williams 2006,
        eq. 2.25, with the prospects as mean and covariance.
        """
        weights, earned = self.weights(history), self.prospects.rewards
        task, mean = self.expectations.task, earned @ weights
        off = earned - mean[:, None]
        tried = [(entry.particle, [t.reward for t in entry.trials]) for it in history for entry in it if entry.trials]
        at = np.array([self.prospects.nearest(task, particle) for particle, _ in tried], dtype=np.intp)
        unit = task.parameters.normalise(self.prospects.candidates)
        squared = ((unit[:, None] - unit[at][None]) ** 2).sum(axis=-1)
        shared = (off * weights) @ off[at].T + LEVEL_STD**2 + REALITY_STD**2 * np.exp(-0.5 * squared / LENGTH**2)
        variance = (off**2) @ weights + LEVEL_STD**2 + REALITY_STD**2
        if tried:
            noise = task.adaptation.trial_std**2 / np.array([len(r) for _, r in tried])
            gain = np.linalg.solve(shared[at] + np.diag(noise), shared.T).T
            mean = mean + gain @ (np.array([np.mean(r) for _, r in tried]) - mean[at])
            variance = variance - (gain * shared).sum(axis=1)
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def _best(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        return self.prospects.spread_out(self.expectations.task, *self.estimate(history), n)

    def _log_likelihood(self, trial: Trial) -> Array:
        """(T,) log-likelihoods of its trajectory, up to a constant."""
        if trial.key not in self._known:
            self._known[trial.key] = self.compare(trial, self.prospects.truths)
        return self._known[trial.key]

    def compare(self, trial: Trial, parameters: Array) -> Array:
        """(N,) log-likelihoods of a trial's trajectory for parameters (N, p) in units, up to a constant."""
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
