"""The contract of an adaptation method: trials in, particles out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from hw.types import Array, frozen_array
from sim.errors import MomentsMissing
from sim.solvers.solver import policy_for

if TYPE_CHECKING:
    from sim.rollouts.kept import KeptRollouts
    from sim.tasks.task import Executable, Policies, SolvedPolicy, Solver, Task

WORTHWHILE = 0.05
"""The smallest gain of reward that is worth an iteration."""

ENOUGH = 2
"""Number of iterations after which a session is done. The second one is the first that tries a policy chosen by trials,
and no other rule has shown more skill than this one (docs/decisions/0018-refine-where-the-weight-is.md)."""

REFUTED = 0.5
"""The latest iteration refutes its leading policy if that earned less than this share of the predicted reward."""

HOPELESS = 0.4
"""A session is hopeless below this upper end of the interval."""

FAILURES, FAILED = 12, 0.05
"""A session is also hopeless after this many trials in a row that earned no more than this.

All three were chosen on development worlds (docs/decisions/0011-one-method.md)."""


@dataclass(frozen=True, eq=False)
class Particle:
    """One parameter distribution E that adapts through a session, as samples in units.

    AdaptSim's Gaussian is so narrow that its only sample is its mean; a particle of UDR has many samples over all of
    Omega.
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
    """One real trial, in the form for learning."""

    context: Array  # (c,) in units
    action: Array  # (a,) commanded, in units
    observation: Array  # (size,) normalised
    reward: float
    end_state: Array | None  # (k,) quantities that decide the reward of a success; None: it failed
    predicted: float = math.nan  # reward that its policy predicted before it; nan: unknown

    @property
    def key(self) -> bytes:
        """Digest that is the same for the same trial."""
        return b"".join(part.tobytes() for part in (self.context, self.action, self.observation))


def require_whole(method: str, trials: Iterable[Trial]) -> None:
    """Raises MomentsMissing unless all moments of the trials were observed, for a method that needs them."""
    missing = sum(not np.isfinite(trial.observation).all() for trial in trials)
    if missing:
        raise MomentsMissing(
            f"{method} needs every moment of a trial, and {missing} of the trials miss some: adapt with adaptsim, "
            "which learns from partial observations, or report whole trajectories"
        )


def trials_of_rows(
    contexts: Array, actions: Array, observations: Array, rewards: Array, ends: Iterable[Array | None]
) -> tuple[Trial, ...]:
    """N trials, one from each row of contexts (N, c), actions (N, a), observations (N, size), rewards (N,), and N end
    states.
    """
    rows = zip(contexts, actions, observations, rewards, ends, strict=True)
    return tuple(Trial(c, a, o, float(r), end) for c, a, o, r, end in rows)


@dataclass(frozen=True, eq=False)
class ParticleTrials:
    """The trials of one particle in one iteration."""

    particle: Particle
    trials: tuple[Trial, ...]


Iteration = tuple[ParticleTrials, ...]
"""One iteration of a session: every particle with its trials."""


def trials_in(history: Sequence[Iteration]) -> list[Trial]:
    """All trials of these iterations, in order."""
    return [trial for iteration in history for entry in iteration for trial in entry.trials]


@dataclass(frozen=True, eq=False)
class Best:
    """The final parameters of a session, and their estimated reward on the real target."""

    particle: Particle
    mean_reward: float
    ci95: tuple[float, float]
    trials: int  # number of trials behind the estimate


@dataclass(frozen=True, eq=False)
class SessionForecast:
    """The forecast of the final policy that a session would have if it ended now."""

    reward: float  # expected
    ci95: tuple[float, float]  # of the expected reward, over all draws of reality
    failures: int  # trials without reward since the last one with some
    untried: bool  # no trial has confirmed a policy like the one that the session would end with
    correction: Array  # (a,) in units: mean difference between its actions and those of `for_e`
    correction_std: Array  # (a,) standard deviation over contexts

    @property
    def done(self) -> bool:
        """Whether another iteration is not worth its trials. A policy that no trial has confirmed is never enough."""
        return self.hopeless or not self.untried

    @property
    def hopeless(self) -> bool:
        """Whether no action in the ranges is expected to work, or no trial has worked for a long time."""
        return self.ci95[1] < HOPELESS or self.has_only_failed

    @property
    def has_only_failed(self) -> bool:
        """Whether no trial has worked for a long time."""
        return self.failures >= FAILURES


class Method(Protocol):
    """A way to choose the next parameter distributions from the trials so far."""

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first `n` particles."""

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next particles, as many as in the last iteration, from all iterations so far (oldest first)."""


@runtime_checkable
class OwnPolicies(Protocol):
    """A method with its own task policies, made from its trials instead of by a solver."""

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The policy that a particle tries after all trials of `history`. Deterministic."""

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The final policy after all trials of `history`."""


@runtime_checkable
class Forecasting(Protocol):
    """A method that judges its session itself, and forecasts the gain of another iteration."""

    def assess(self, history: Sequence[Iteration]) -> tuple[Best, SessionForecast]:
        """The final parameters, and the forecast. Raises ValueError without a trial."""


class ExpectedTrajectories(Protocol):
    """The part of `sim.solvers.solver.Expectations` that predictions of trajectories need."""

    @property
    def task(self) -> Task:
        """The task of the trials."""

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array) -> Array:
        """(N, size)"""


@runtime_checkable
class Simulating(Protocol):
    """A method that simulates in the session. So it needs no Phase 1, and it has draws of likely parameters."""

    @property
    def solver(self) -> Solver:
        """Its task policies, by true rollouts."""

    @property
    def rollouts(self) -> KeptRollouts:
        """All rollouts that it has simulated."""

    def draws_after_each(self, history: Sequence[Iteration]) -> tuple[Array, ...]:
        """(N, p) equally likely parameters of the margin, in units: before the first iteration, and after each."""

    def near_fit(self, history: Sequence[Iteration]) -> ExpectedTrajectories:
        """Trajectories of the trials in `history` for likely parameters, which need no further rollout."""

    def rollouts_before(self, particles: int) -> int:
        """The most rollouts before the first trial of a session."""

    def rollouts_after(self, particles: int, iteration: int) -> int:
        """The most rollouts after an iteration, numbered from 1."""


@runtime_checkable
class Choosing(Protocol):
    """A method that chooses the parameters that its session keeps; for others `sim.adaptation.judging.choose_best`
    does.
    """

    def choose(self, history: Sequence[Iteration]) -> Best:
        """The final parameters. Raises ValueError without a trial."""


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
