"""The posterior of a session over outcomes: candidate simulators, and the discrepancy of reality from each.

1. A *simulator* is the emulator at one set of parameters. Each trial weighs it: by its trajectory, by whether it
   succeeded, and by where a success ended.
2. No parameters describe reality exactly. Its discrepancy in the chance of success and in the end state is a smooth
function of the action, and of a context that moves things (`Discrepancy`). It explains a residual that several trials
share; only the unexplained rest weighs simulators.
3. Many pairs of a simulator and such functions are drawn. Each predicts the reward of any action in any context;
together they give the expected reward and its uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from hw.types import Array, frozen_array
from sim.adaptation.densities import systematic, weights_of
from sim.adaptation.discrepancy import (
    END,
    FACTORS,
    FACTORS_STD,
    LEAST_CHANCE_STD,
    LEAST_END_STD,
    SUCCESS,
    Discrepancy,
    DiscrepancyScale,
)
from sim.adaptation.method import Trial
from sim.adaptation.simulators import Candidates, Predicted, Simulators
from sim.rollouts.draws import sobol
from sim.solvers.candidates import CandidatePolicy, Outcomes, first_executable
from sim.tasks.task import Executable, Task
from sim.types import PredictedOutcomes

WIDER = 2.0
"""The interval of a predicted reward is so much wider than that of the draws, which held too few rewards of developed
worlds (docs/decisions/0011).
"""

KEPT = 48
"""Number of draws of a simulator and its discrepancies."""

ACTIONS, REFINED = 256, 16
"""Number of actions that fill their ranges, and number of those around the best one."""


@dataclass(frozen=True, eq=False)
class OutcomePosterior:
    """Possible realities after some trials: `KEPT` equally likely draws of a simulator and its discrepancies."""

    simulators: Simulators
    trials: tuple[Trial, ...]
    _outcomes: dict[bytes, Outcomes] = field(default_factory=dict, repr=False)  # by `Task.simulated_in`

    @cached_property
    def weights(self) -> Array:
        """(T,) probabilities of `Simulators.truths`, which follow the prior: their posterior.

        No point of a grid is the truth, and a point is as wrong in every trial: together they count as one on average.
        """
        if not self.trials:
            return np.full(len(self.simulators.truths), 1.0 / len(self.simulators.truths))
        return weights_of(self._log_posterior(self.simulators.on_grid(self.trials)))

    @cached_property
    def parameters(self) -> Array:
        """(KEPT, p) parameters of the drawn simulators, in units."""
        parameters, weights = self.posterior
        return frozen_array(parameters[systematic(weights, KEPT)])

    @cached_property
    def posterior(self) -> tuple[Array, Array]:
        """(N, p) parameters in units, and their probabilities (N,): the cloud, or points around an exact fit."""
        first = self._candidates
        if first.predicted is None:
            return first.parameters, self.weights
        return first.parameters, weights_of(first.log_prior + self._log_posterior(first.predicted))

    def _log_posterior(self, predicted: Predicted) -> Array:
        """(K,) log-likelihoods of simulators by trajectories, success and end states."""
        log = predicted.log_likelihood.sum(axis=0) + self._success_discrepancy.evidence(
            self._success_residuals(predicted)
        )
        for discrepancy, residuals in zip(self._end_discrepancies, self._end_residuals(predicted), strict=True):
            log = log + discrepancy.evidence(residuals)
        log = log * self.simulators.strengths.weights
        return np.asarray(log / len(self.trials) if self.simulators.is_grid else log)

    def candidate_outcomes(self, context: Array) -> Outcomes:
        """The outcomes of candidate actions in a context (c,). In every context there are equally many candidates."""
        key = self.simulators.task.simulated_in(context).tobytes()
        if key not in self._outcomes:
            best_for = np.concatenate([self.parameters, self.simulators.reward_table.candidates])
            self._outcomes[key] = self.outcomes(self.simulators.actions(best_for, ACTIONS, context), context)
        return self._outcomes[key]

    def outcomes(self, actions: Array, context: Array) -> Outcomes:
        """(A, a) in units -> their outcomes (A, KEPT, D) in every draw."""
        task, drawn, unit = self.simulators.task, self.simulators.disturbances, self.simulators.end_unit
        predicted = self.simulators.solver.outcomes(
            self.parameters[None, :, None], actions[:, None, None] + drawn.error, drawn.nuisance, context
        )
        at = self.simulators.places(actions, context)
        added = [
            discrepancy.drawn(at, residuals, seed) for seed, (discrepancy, residuals) in enumerate(self._discrepancies)
        ]
        mean = predicted.mean_of_ensemble
        chance = np.clip(mean.success + added[0][..., None], 0.0, 1.0)
        end = mean.end_state + (np.stack(added[1:], axis=-1) * unit)[:, :, None]
        return Outcomes(task, actions, PredictedOutcomes(chance, end, mean.failure_reward))

    @cached_property
    def _discrepancies(self) -> list[tuple[Discrepancy, Array]]:
        """The conditioned discrepancies in the chance of success and in each end-state quantity."""
        if not self.trials:
            d, k = self.simulators.place_size, len(self.simulators.end_unit)
            scales = [scale.times(self.simulators.strengths.discrepancy) for scale in (SUCCESS, *[END] * k)]
            nothing = [Discrepancy(scale, np.zeros((0, d)), np.zeros(0)) for scale in scales]
            return [(unknown, np.zeros((0, KEPT))) for unknown in nothing]
        predicted = self.simulators.predict(self.trials, self.parameters, self._candidates.left)
        ends = zip(self._end_discrepancies, self._end_residuals(predicted), strict=True)
        return [(self._success_discrepancy, self._success_residuals(predicted)), *ends]

    def _success_residuals(self, predicted: Predicted) -> Array:
        """(N, K) observed success minus predicted chance."""
        return self._succeeded[:, None] - predicted.success

    def _end_residuals(self, predicted: Predicted) -> list[Array]:
        """Observed minus predicted end states, (successes, K) for each quantity."""
        shown = np.array([t.end_state for t in self.trials if t.end_state is not None]).reshape(-1, self._end_size)
        residuals = shown[:, None] / self.simulators.end_unit - predicted.end[self._succeeded]
        return [residuals[..., axis] for axis in range(self._end_size)]

    @cached_property
    def _success_discrepancy(self) -> Discrepancy:
        """The discrepancy in the chance of success."""
        expected = self._predicted.success @ self._trajectory_weights
        noise = expected * (1.0 - expected) + LEAST_CHANCE_STD**2
        return self._likeliest(SUCCESS, self._points, noise, self._success_residuals(self._predicted))

    @cached_property
    def _end_discrepancies(self) -> list[Discrepancy]:
        """The discrepancy in each end-state quantity."""
        spread = np.einsum("nkd,k->nd", self._predicted.spread[self._succeeded], self._trajectory_weights)
        noise = spread + LEAST_END_STD**2
        at, off = self._points[self._succeeded], self._end_residuals(self._predicted)
        return [self._likeliest(END, at, noise[:, axis], off[axis]) for axis in range(self._end_size)]

    def _likeliest(self, scale: DiscrepancyScale, at: Array, noise: Array, residuals: Array) -> Discrepancy:
        """The discrepancy with the multiple of `scale` that best explains residuals (N, T) over all simulators
        (empirical Bayes).
        """
        most = self._candidates.left * self.simulators.strengths.discrepancy
        candidates = [Discrepancy(scale.times(factor * most), at, noise) for factor in FACTORS]
        paths = self._log_trajectory_weights
        explained = [logsumexp(paths + one.evidence(residuals)) for one in candidates]
        before = -0.5 * (np.log(FACTORS) / FACTORS_STD) ** 2
        return candidates[int(np.argmax(explained + before))]

    @cached_property
    def _candidates(self) -> Candidates:
        return self.simulators.candidates(self.trials)

    @property
    def _predicted(self) -> Predicted:
        assert self._candidates.predicted is not None  # asked for only after a trial
        return self._candidates.predicted

    @cached_property
    def _trajectory_weights(self) -> Array:
        """(K,) weights by the trajectories only; the noise of trials is averaged with them."""
        return weights_of(self._log_trajectory_weights)

    @cached_property
    def _log_trajectory_weights(self) -> Array:
        """(K,) logarithms of these weights, up to a constant."""
        by_trajectories = self._predicted.log_likelihood.sum(axis=0)
        return np.asarray(self._candidates.log_prior + self.simulators.strengths.weights * by_trajectories)

    @cached_property
    def _points(self) -> Array:
        actions, contexts = (np.array([getattr(t, name) for t in self.trials]) for name in ("action", "context"))
        return self.simulators.places(actions, contexts)

    @cached_property
    def _succeeded(self) -> Array:
        return np.array([t.end_state is not None for t in self.trials])

    @property
    def _end_size(self) -> int:
        return len(self.simulators.end_unit)


@dataclass(frozen=True, eq=False)
class PosteriorPolicy(CandidatePolicy):
    """A `SolvedPolicy`: the action with the highest expected reward plus `optimism` standard deviations."""

    posterior: OutcomePosterior
    optimism: float = 0.0
    executable: Executable | None = None
    attempts: int = 64
    _near: dict[tuple[bytes, int], Outcomes] = field(default_factory=dict, repr=False)

    @property
    def task(self) -> Task:
        """The task of the simulators."""
        return self.posterior.simulators.task

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if none of the best actions can be executed."""
        attempts = self.attempts if self.posterior.simulators.refines else None
        return first_executable(*self.ranked(context), context, self.executable, self.task, attempts)

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Predicted reward of the action at `context`, with its 95 % interval (`predicted_interval`)."""
        earned = self.outcomes(self(context)[None], context).rewards(context)[0]
        return float(earned.mean()), *predicted_interval(earned)

    @property
    def prefers_interior(self) -> bool:
        """Before any trial, for the action that has to be safe."""
        return self.optimism <= 0.0 and not self.posterior.trials and self.posterior.simulators.refines

    def everywhere(self, context: Array) -> Outcomes:
        """The outcomes of the candidate actions."""
        return self.posterior.candidate_outcomes(context)

    def steps(self) -> Array:
        """(REFINED, a); none if there are no other actions."""
        a = len(self.task.action)
        around = (2.0 * sobol(REFINED, a, np.random.default_rng(0)) - 1.0) * ACTIONS ** (-1.0 / a)
        return np.asarray(around if self.posterior.simulators.refines else around[:0])

    def outcomes(self, actions: Array, context: Array) -> Outcomes:
        """The outcomes of actions (A, a) in every draw."""
        return self.posterior.outcomes(actions, context)

    def worth(self, outcomes: Outcomes, context: Array) -> Array:
        """(A,) rounded, so that equal actions tie."""
        earned = outcomes.rewards(context)
        return np.asarray(np.round(earned.mean(axis=1) + self.optimism * earned.std(axis=1), 9))


def predicted_interval(earned: Array) -> tuple[float, float]:
    """The 95 % interval of a predicted reward, from its values (K,) in the draws of reality."""
    mean = float(earned.mean())
    low, high = np.clip(mean + WIDER * (np.quantile(earned, [0.025, 0.975]) - mean), 0.0, 1.0)
    return float(low), float(high)
