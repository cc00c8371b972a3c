"""The contract of an adaptation method: trials in, particles out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from hw.types import Array, frozen_array
from sim.solvers.solver import Executable, Policies, SolvedPolicy, policy_for


@dataclass(frozen=True, eq=False)
class Particle:
    """One parameter distribution E that adapts through a session, as samples in units.

    AdaptSim's Gaussian is so narrow that its one sample is its mean; UDR holds many over all of Omega.
    """

    samples: Array  # (m, p)

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", frozen_array(self.samples, (None, None), "samples"))

    @property
    def mean(self) -> Array:
        """(p,) mean of the samples, in units."""
        return np.asarray(self.samples.mean(axis=0))


@dataclass(frozen=True, eq=False)
class Trial:
    """One real execution, in the form for learning."""

    context: Array  # (c,) in units
    action: Array  # (a,) commanded, in units
    observation: Array  # (size,) normalised
    reward: float
    end_state: Array | None  # (k,) quantities that decide the reward of a success; None: it failed


@dataclass(frozen=True, eq=False)
class ParticleTrials:
    """The trials of one particle in one iteration."""

    particle: Particle
    trials: tuple[Trial, ...]


Iteration = tuple[ParticleTrials, ...]
"""One iteration of a session: every particle with its trials."""


class Method(Protocol):
    """A way to choose the next parameter distributions from the trials so far."""

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first `n` particles."""
        ...

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles, as many as in the last iteration, from all iterations so far (oldest first)."""
        ...


@runtime_checkable
class OwnPolicies(Protocol):
    """A method with its own task policies, made from its trials instead of by a solver."""

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The policy that a particle tries after all trials of `history`. Deterministic."""
        ...

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The final policy after all trials of `history`."""
        ...


def policy_of(
    method: Method,
    policies: Policies,
    particle: Particle,
    history: Sequence[Iteration],
    executable: Executable | None = None,
) -> SolvedPolicy:
    """The task policy of a particle after `history`: the solver's for its parameters, or the method's own."""
    if isinstance(method, OwnPolicies):
        return method.policy(particle, history, executable)
    return policy_for(policies, particle.samples, executable)


@dataclass(frozen=True, eq=False)
class Best:
    """The final parameters of a session, and their estimated reward on the real target."""

    particle: Particle
    mean_reward: float
    ci95: tuple[float, float]
    trials: int  # number of trials behind the estimate
