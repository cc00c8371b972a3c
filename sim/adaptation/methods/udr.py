"""Uniform domain randomisation: one task policy for all of Omega, and nothing is adapted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.rollouts.draws import cover
from sim.solvers.solver import SolvedPolicy, Solver, policy_for
from sim.tasks.task import Task

SAMPLES = 64
"""Parameters that stand for all of Omega."""

DRAWS = 4
"""Policies behind what UDR is said to earn."""


def create(task: Task, checkpoint: Checkpoint | None) -> Udr:
    """The method's entry in `METHODS`; it needs no checkpoint."""
    return Udr(task)


def udr_policies(solver: Solver, rng: np.random.Generator, n: int = DRAWS) -> tuple[SolvedPolicy, ...]:
    """`n` policies for all of Omega, from different draws; what UDR earns is the mean over them.

    Over Omega many actions earn alike, and which of them a solver picks is arbitrary. In one given target they may
    differ as much as success and failure.
    """
    starts = Udr(solver.task).start(n, rng)
    return tuple(policy_for(solver, particle.samples, seed=k) for k, particle in enumerate(starts))


@dataclass(frozen=True, eq=False)
class Udr:
    """A `Method` whose particles never change."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """`n` particles, each over all of Omega."""
        return tuple(Particle(cover(self.task.parameters, SAMPLES, rng)) for _ in range(n))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The same as before."""
        return tuple(seen.particle for seen in history[-1])
