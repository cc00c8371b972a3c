"""What the sequence of a session asks of what learns; `wiring` fills it in, tests bring their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from sim.adaptation.method import Best, Iteration, Particle
from sim.adaptation.outlook import Outlook
from sim.adaptation.posterior import Posterior
from sim.tasks.solver import SolvedPolicy


class ExpectedReward(NamedTuple):
    """What training expects of an action at a context."""

    reward: float
    low: float  # of the emulator's ensemble, two standard deviations
    high: float


class Assessment(NamedTuple):
    """What the data say of a session."""

    best: Best
    verdict: str  # one sentence
    outlook: Outlook | None  # None: the method does not look ahead


@runtime_checkable
class Believing(Protocol):
    """A learner that can say what the trials tell of the true parameters."""

    def posterior(self, history: Sequence[Iteration]) -> Posterior | None:
        """None where its method holds no belief."""
        ...


class SessionLearner(Protocol):
    """A method of adaptation together with the training of its task policies."""

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first `n` particles."""
        ...

    def train(self, particle: Particle, history: Sequence[Iteration]) -> SolvedPolicy:
        """Its task policy after the iterations of `history`; for the same of both the same one."""
        ...

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The particles that follow from all iterations so far."""
        ...

    def final(self, history: Sequence[Iteration]) -> SolvedPolicy:
        """The task policy that a session would go with."""
        ...

    def judge(self, history: Sequence[Iteration]) -> Assessment:
        """What the data say of the session."""
        ...
