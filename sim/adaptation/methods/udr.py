"""Uniform domain randomisation: one task policy for all of Omega, without adaptation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.rollouts.draws import cover
from sim.solvers.solver import policy_for
from sim.tasks.task import SolvedPolicy, Solver, Task

SAMPLES = 64
"""Number of parameter vectors that represent all of Omega."""

DRAWS = 8
"""Number of policies behind the reward of UDR, wherever it is stated: on a card, in a report, in a benchmark."""


def create(task: Task, checkpoint: Checkpoint | None) -> Udr:
    """The method's entry in `METHODS`; it needs no checkpoint."""
    return Udr(task)


def udr_policies(solver: Solver, rng: np.random.Generator, count: int = DRAWS) -> tuple[SolvedPolicy, ...]:
    """`count` policies for all of Omega, trained from different draws. The reward of UDR is the mean of their rewards.

    Over Omega many actions earn the same, and the solver's choice among them is arbitrary. In one target they may
    differ as much as success and failure.
    """
    starts = Udr(solver.task).start(count, rng)
    return tuple(policy_for(solver, particle.samples, seed=k) for k, particle in enumerate(starts))


@dataclass(frozen=True, eq=False)
class Udr:
    """A `Method` whose particles never change."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """`n` particles, each over all of Omega."""
        return tuple(Particle(cover(self.task.parameters, SAMPLES, rng)) for _ in range(n))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The same particles as before."""
        return tuple(entry.particle for entry in history[-1])
