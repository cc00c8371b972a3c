"""The adapting part of a session: a method, the training of its task policies, and the judgement of the trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim.adaptation.judging import Misfits, assess, final_policy, repeated_trials, verdict_of
from sim.adaptation.method import Best, Iteration, Method, Particle, SessionForecast, Simulating, policy_of
from sim.adaptation.posterior import Posterior, posterior
from sim.adaptation.trajectory_likelihood import TrajectoryLikelihood
from sim.adaptation.verdict import Verdict
from sim.tasks.task import Executable, Expectations, Policies, SolvedPolicy


class Assessment(NamedTuple):
    """The judgement of a session by its trials."""

    best: Best
    verdict: Verdict
    forecast: SessionForecast | None  # None: the method makes no forecast
    tried: tuple[int, ...]  # trials, numbered from 1, whose action the final policy would repeat


@dataclass(frozen=True, eq=False)
class Adaptation:
    """An adaptation method, its task policies, and the simulator's predictions of trials."""

    method: Method
    policies: Policies
    expectations: Expectations
    executable: Executable | None = None  # None: every action is
    likelihood: TrajectoryLikelihood | Simulating | None = None  # for display; a method may have its own

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first `n` particles."""
        return self.method.start(n, rng)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles, from all iterations so far."""
        return self.method.next(history, rng)

    def train(self, particle: Particle, history: Sequence[Iteration]) -> SolvedPolicy:
        """The particle's task policy after the iterations of `history`. Deterministic."""
        return policy_of(self.method, self.policies, particle, history, self.executable)

    def final(self, history: Sequence[Iteration]) -> SolvedPolicy:
        """The final task policy, if the session ended now. Raises ValueError without a trial."""
        return final_policy(self.method, self.policies, self.policies.task, history, self.executable)

    def assess(self, history: Sequence[Iteration]) -> Assessment:
        """Best particle, verdict and forecast from the trials so far. Raises ValueError without a trial."""
        task = self.expectations.task
        best, forecast = assess(self.method, task, history)
        verdict = verdict_of(task, history, self._misfits, best, forecast)
        return Assessment(best, verdict, forecast, repeated_trials(self.final(history), task, history))

    def posterior(self, history: Sequence[Iteration]) -> Posterior | None:
        """The posterior of the true parameters after `history`; None without a likelihood."""
        return None if self.likelihood is None else posterior(self.likelihood, history)

    @cached_property
    def _misfits(self) -> Misfits:
        return Misfits(self.expectations)
