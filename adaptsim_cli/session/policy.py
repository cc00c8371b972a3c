"""The interface between a session and its learning method; `wiring` provides it, tests bring their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from sim.adaptation.method import Best, Iteration, Outlook, Particle
from sim.adaptation.posterior import Posterior
from sim.adaptation.verdict import Verdict
from sim.tasks.solver import SolvedPolicy


class ExpectedReward(NamedTuple):
    """The reward that training expects of an action in a context."""

    reward: float
    low: float  # mean of the emulator's ensemble minus two standard deviations
    high: float


class Assessment(NamedTuple):
    """The judgement of a session by its trials."""

    best: Best
    verdict: Verdict
    outlook: Outlook | None  # None: the method makes no forecast


@runtime_checkable
class Believing(Protocol):
    """A learner with a belief about the true parameters."""

    def posterior(self, history: Sequence[Iteration]) -> Posterior | None:
        """The belief after `history`; None if the method has none."""
        ...


class SessionLearner(Protocol):
    """An adaptation method together with the training of its task policies."""

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first `n` particles."""
        ...

    def train(self, particle: Particle, history: Sequence[Iteration]) -> SolvedPolicy:
        """The particle's task policy after the iterations of `history`. Deterministic."""
        ...

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles, from all iterations so far."""
        ...

    def final(self, history: Sequence[Iteration]) -> SolvedPolicy:
        """The final task policy of a session that ended now."""
        ...

    def judge(self, history: Sequence[Iteration]) -> Assessment:
        """Best particle, verdict and outlook by the trials so far."""
        ...
