"""LearnInTarget of the paper: the task policy is trained on real trials only, without simulation.

The paper trains a network, which would have only twenty samples. A Gaussian process of the reward over context and
action uses them better, so it is used here as a stronger baseline. It explores by Thompson sampling: a trial gets the
best action of one function drawn from the posterior. Its final policy takes the highest mean.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle
from sim.rollouts.draws import cover, sobol
from sim.solvers.candidates import first_executable
from sim.tasks.task import Executable, SolvedPolicy, Task

ACTIONS = 256
"""Number of candidate actions, spread evenly over the action space."""

PRIOR_MEAN, SIGNAL_STD, LENGTH = 0.3, 0.35, 0.3
"""Prior of the reward over contexts and actions, in fractions of their ranges."""

ATTEMPTS = 64
"""Number of actions that are checked against the arm's limits before the search ends."""

CLAIMS = 64
"""Samples of a particle. They fill Omega, because the method says nothing about parameters."""


def create(task: Task, checkpoint: Checkpoint | None) -> LearnInTarget:
    """The method's entry in `METHODS`; it needs no checkpoint."""
    return LearnInTarget(task)


@dataclass(frozen=True, eq=False)
class LearnInTarget:
    """A `Method` that brings its own task policies (`sim.adaptation.method.OwnPolicies`)."""

    task: Task

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """`n` particles over all of Omega. Each has other samples, so that its draws differ from the others'."""
        dimensions = len(self.task.parameters)
        return tuple(Particle(self.task.parameters.spread(sobol(CLAIMS, dimensions, rng))) for _ in range(n))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The same particles: only the task policy is learnt."""
        return tuple(tried.particle for tried in history[-1])

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The particle's next policy; the same in every process."""
        return self._learnt(history, executable, particle.samples.tobytes())

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The final policy after all trials of `history`."""
        return self._learnt(history, executable, None)

    def _learnt(
        self, history: Sequence[Iteration], executable: Executable | None, drawn_by: bytes | None
    ) -> LearntPolicy:
        task = self.task
        trials = [trial for iteration in history for tried in iteration for trial in tried.trials]
        at = [_point(task, trial.context, trial.action) for trial in trials]
        return LearntPolicy(
            task=task,
            at=np.array(at).reshape(len(trials), len(task.context) + len(task.action)),
            rewards=np.array([trial.reward for trial in trials]),
            candidates=cover(task.action, ACTIONS, np.random.default_rng(0)),
            executable=executable,
            drawn_by=drawn_by,
        )


@dataclass(frozen=True, eq=False)
class LearntPolicy:
    """A `SolvedPolicy`: the best action of a drawn function, or of the mean if `drawn_by` is None."""

    task: Task
    at: Array  # (N, c + a) contexts and actions of the trials, in fractions of the ranges
    rewards: Array  # (N,)
    candidates: Array  # (ACTIONS, a) in units
    executable: Executable | None
    drawn_by: bytes | None  # part of the seed of the draws
    _worths: dict[bytes, Array] = field(default_factory=dict, repr=False)  # worth of the candidates, by context

    def __call__(self, context: Array) -> Array:
        """(c,) -> (a,). Raises NotExecutable if none of the best candidates keeps the limits."""
        return first_executable(self.candidates, self._worth(context), context, self.executable, self.task, ATTEMPTS)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check."""
        return np.stack([self.candidates[int(np.argmax(self._worth(context)))] for context in contexts])

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of the action at `context`: mean, and mean ± two standard deviations."""
        mean, covariance = self._posterior(_point(self.task, context, self(context))[None])
        expected, std = float(mean[0]), float(np.sqrt(covariance[0, 0]))
        low, high = np.clip((expected - 2.0 * std, expected + 2.0 * std), 0.0, 1.0)
        return float(np.clip(expected, 0.0, 1.0)), float(low), float(high)

    def _worth(self, context: Array) -> Array:
        """(ACTIONS,) rounded values. Ties keep the order of the set, which fills the space evenly."""
        key = np.ascontiguousarray(context).tobytes()
        if key not in self._worths:
            mean, covariance = self._posterior(_point(self.task, np.tile(context, (ACTIONS, 1)), self.candidates))
            worth = mean
            if self.drawn_by is not None:
                seed = hashlib.sha256(self.drawn_by + key + self.rewards.tobytes()).digest()[:8]
                rng = np.random.default_rng(int.from_bytes(seed, "big"))
                values, vectors = np.linalg.eigh(covariance)
                worth = mean + vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(ACTIONS))
            self._worths[key] = worth.round(9)
        return self._worths[key]

    def _posterior(self, points: Array) -> tuple[Array, Array]:
        """Mean (P,) and covariance (P, P) of the expected reward at (P, c + a): R. & W. 2006, eq. 2.25 and 2.26."""
        prior = _kernel(points, points)
        if len(self.rewards) == 0:
            return np.full(len(points), PRIOR_MEAN), prior
        covariance = _kernel(self.at, self.at) + self.task.adaptation.trial_std**2 * np.eye(len(self.at))
        shared = _kernel(points, self.at)
        gain = np.linalg.solve(covariance, shared.T).T
        return PRIOR_MEAN + gain @ (self.rewards - PRIOR_MEAN), prior - gain @ shared.T


def _point(task: Task, context: Array, action: Array) -> Array:
    return np.concatenate([task.context.normalise(context), task.action.normalise(action)], axis=-1)


def _kernel(a: Array, b: Array) -> Array:
    squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
    return np.asarray(SIGNAL_STD**2 * np.exp(-0.5 * squared / LENGTH**2))
