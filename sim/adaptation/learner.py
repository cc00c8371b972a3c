"""The adapting part of a session: a method, the training of its task policies, and the judgement of the trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim.adaptation.judging import Misfits, assess, final_policy, judge, repeated_trials
from sim.adaptation.method import Best, ExpectedGain, Iteration, Method, Particle, Simulating, policy_of
from sim.adaptation.methods.belief import Belief
from sim.adaptation.posterior import Posterior, posterior
from sim.adaptation.verdict import Verdict
from sim.solvers.solver import Executable, Expectations, Policies, SolvedPolicy


class Assessment(NamedTuple):
    """The judgement of a session by its trials."""

    best: Best
    verdict: Verdict
    outlook: ExpectedGain | None  # None: the method makes no forecast
    tried: tuple[int, ...]  # trials, numbered from 1, whose action the final policy would repeat


@dataclass(frozen=True, eq=False)
class Learner:
    """An adaptation method, its task policies, and the simulator's predictions of trials."""

    method: Method
    policies: Policies
    expectations: Expectations
    executable: Executable | None = None  # None: every action is
    belief: Belief | Simulating | None = None  # for display; a method may have its own

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
        """The final task policy of a session that ended now. Raises ValueError without a trial."""
        return final_policy(self.method, self.policies, self.policies.task, history, self.executable)

    def judge(self, history: Sequence[Iteration]) -> Assessment:
        """Best particle, verdict and outlook by the trials so far. Raises ValueError without a trial."""
        task = self.expectations.task
        best, ahead = assess(self.method, task, history)
        verdict = judge(task, history, self._misfits, best, ahead)
        return Assessment(best, verdict, ahead, repeated_trials(self.final(history), task, history))

    def posterior(self, history: Sequence[Iteration]) -> Posterior | None:
        """The belief about the true parameters after `history`; None if there is none."""
        return None if self.belief is None else posterior(self.belief, history)

    @cached_property
    def _misfits(self) -> Misfits:
        return Misfits(self.expectations)
