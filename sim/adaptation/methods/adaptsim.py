"""AdaptSim, the default method: combines the simulator with the trials; a policy is an E plus a correction.

`OutcomePosterior` describes all possible realities. The first particle takes the action with the highest expected
reward, whether or not any E proposes it. If two actions earn the same, it takes the surer one. The other particles
explore actions that may earn still more; they explore less with every iteration, and the last ones confirm. As long as
every trial has failed, nothing can be lost, so all particles explore. A particle displays the E whose policy is
expected to earn most. The correction is the difference between that policy and the actions of the particle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.method import ENOUGH, REFUTED, Best, Iteration, Particle, ParticleTrials, SessionForecast
from sim.adaptation.outcome_posterior import OutcomePosterior, PosteriorPolicy
from sim.adaptation.reward_table import OPTIMISM
from sim.adaptation.session_forecast import CAUTION, session_forecast
from sim.adaptation.simulators import Simulators
from sim.solvers.solver import policy_for
from sim.tasks.task import Executable, SolvedPolicy, Task

FADES_OVER = 4
"""Number of iterations until exploring particles have no more optimism."""

DESPERATE = 0.5
"""Optimism of the first particle while every trial has failed."""


def create(task: Task, checkpoint: Checkpoint | None) -> AdaptSim:
    """The method's entry in `METHODS`. Raises CheckpointError if the checkpoint cannot predict."""
    reward_table = reward_table_of("adaptsim", task, checkpoint)
    assert checkpoint is not None  # it holds the reward table
    return AdaptSim(Simulators(checkpoint.solver, reward_table))


@dataclass(frozen=True, eq=False)
class AdaptSim:
    """A deterministic `Method` with `OwnPolicies`, and `Forecasting` (`sim.adaptation.method`)."""

    simulators: Simulators
    _posteriors: dict[bytes, OutcomePosterior] = field(default_factory=dict, repr=False)  # by trials

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The E with the highest expected reward before any trial, and others that may earn more."""
        return self._particles([], n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles. They do not depend on `rng`, nor on the earlier places of the particles."""
        return self._particles(history, len(history[-1]))

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The first particle's policy is the best known one; the others explore."""
        leads = np.array_equal(particle.samples, self._particles(history, 1)[0].samples)
        posterior = self.outcome_posterior(history)
        return PosteriorPolicy(posterior, float(_optimism(posterior, len(history), 2)[0 if leads else 1]), executable)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The final policy."""
        posterior = self.outcome_posterior(history)
        return PosteriorPolicy(posterior, 0.0 if _all_failed(posterior) else -CAUTION, executable)

    def assess(self, history: Sequence[Iteration]) -> tuple[Best, SessionForecast]:
        """The final parameters, and the forecast of their reward. Raises ValueError without a trial."""
        posterior, leading = self.outcome_posterior(history), self._particles(history, 1)[0]
        if not posterior.trials:
            raise ValueError("no trial has been run yet, so there is no best")
        for_e = policy_for(self.simulators.solver, leading.samples)
        forecast = forecast_after(posterior, for_e, len(history), refuted=is_refuted(history[-1][0]))
        return Best(leading, forecast.reward, forecast.ci95, len(posterior.trials)), forecast

    def outcome_posterior(self, history: Sequence[Iteration]) -> OutcomePosterior:
        """The knowledge from the trials of `history`; cached per set of trials."""
        trials = tuple(t for iteration in history for tried in iteration for t in tried.trials)
        key = b"".join(trial.key for trial in trials)
        if key not in self._posteriors:
            self._posteriors.clear()
            self._posteriors[key] = OutcomePosterior(self.simulators, trials)
        return self._posteriors[key]

    def _particles(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        reward_table, weights = self.simulators.reward_table, self.outcome_posterior(history).weights
        earned = reward_table.rewards[:, : len(weights)]
        mean = earned @ weights
        std = np.sqrt(np.maximum((earned - mean[:, None]) ** 2 @ weights, 0.0))
        return reward_table.spread_out(self.simulators.task, mean, std, n)


def forecast_after(
    posterior: OutcomePosterior, for_e: SolvedPolicy, iterations: int, *, refuted: bool = False
) -> SessionForecast:
    """The forecast after `iterations`, the last of which may have `refuted` its policy; see `session_forecast`."""
    return session_forecast(posterior, for_e, untried=iterations < ENOUGH or refuted)


def is_refuted(leading: ParticleTrials) -> bool:
    """Whether the first particle earned much less than predicted, so that the session would end with another policy."""
    predicted, earned = (
        np.mean([getattr(trial, name) for trial in leading.trials]) for name in ("predicted", "reward")
    )
    return bool(earned < REFUTED * predicted)  # never where the prediction is unknown (nan)


def _optimism(posterior: OutcomePosterior, iterations: int, particles: int) -> Array:
    """(n,) the optimism of the particles after `iterations`, in standard deviations of the expected reward."""
    if _all_failed(posterior):
        return np.array([DESPERATE, *[OPTIMISM] * (particles - 1)])
    return np.array([-CAUTION, *[OPTIMISM * max(0.0, 1.0 - iterations / FADES_OVER)] * (particles - 1)])


def _all_failed(posterior: OutcomePosterior) -> bool:
    return bool(posterior.trials) and all(trial.end_state is None for trial in posterior.trials)
