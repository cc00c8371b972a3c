"""The parts of one session: task, target and learner. `wiring` makes them, tests bring their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from adaptsim_cli.session.target import Target
from sim.adaptation.method import Best, Iteration, Outlook, Particle
from sim.adaptation.posterior import Posterior
from sim.adaptation.verdict import Verdict
from sim.tasks.solver import SolvedPolicy
from sim.tasks.task import Task


class Assessment(NamedTuple):
    """The judgement of a session by its trials."""

    best: Best
    verdict: Verdict
    outlook: Outlook | None  # None: the method makes no forecast


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

    def posterior(self, history: Sequence[Iteration]) -> Posterior | None:
        """The belief about the true parameters after `history`; None if there is none."""
        ...


@dataclass(frozen=True)
class Provenance:
    """Where the parts come from, for the record; never the hidden parameters of a world."""

    checkpoint: str
    checkpoint_sha256: str
    world_sha256: str  # "": real hardware
    calibration: str  # "": no camera
    calibration_sha256: str
    versions: dict[str, str]
    camera_late_s: float = 0.0  # subtracted from the camera's time stamps
    start_from_sha256: str = ""  # of the posterior that the session begins with


@dataclass(frozen=True)
class Parts:
    """Task, target and learner of one session, with their provenance."""

    task: Task
    target: Target
    learner: SessionLearner
    provenance: Provenance
