"""LaplaceFit and search with true rollouts: the way without Phase 1.

After each iteration the parameters are fitted to all trajectories so far by least squares, and the next task policies
are searched for the fit (`sim.solvers.direct`). All particles but the first take a draw from the posterior, so they try
other parameters that may be true (Thompson sampling).

The posterior is Laplace's approximation: it is normal around the best fit, and its width follows from the misfit that
the fit leaves. So a simulator that cannot repeat the trials gives a wide posterior, not a sharp wrong one. The
approximation has one best fit, and misses a second one far away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.descent import FEW_STEPS, curvature, descend_with_few
from sim.adaptation.judging import choose_best
from sim.adaptation.method import Iteration, Particle, Trial, trials_in
from sim.adaptation.methods.udr import SAMPLES
from sim.rollouts.draws import cover
from sim.rollouts.executors import serial_executor
from sim.rollouts.kept import KeptRollouts
from sim.rollouts.run import Requests
from sim.solvers.direct import DirectSolver, rollouts_of
from sim.solvers.misfit import VALUES, offsets
from sim.solvers.solver import policy_for
from sim.tasks.task import Executable, SolvedPolicy, Task

SCENARIOS = 3
"""Number of parameter vectors for which the first particle's policy is searched: the best fit, and draws from the
posterior."""

CLOUD = 12
"""Number of parameter vectors that fill the margin; a fit begins from the best one."""

DIFFERENCE = 0.02
"""Step of a difference quotient, as a fraction of the margin: above the noise of a contact solver."""

LEAST_LEFT = 0.01
"""Smallest misfit that counts as more than rounding, in units of the tolerated deviation of a trajectory."""

DRAWS = 256
"""Number of draws that represent a posterior."""


def create(task: Task, checkpoint: Checkpoint | None) -> Direct:
    """The method's entry in `METHODS`. A session with `--solver direct` gives its rollouts; otherwise they are in
    memory.
    """
    solver = None if checkpoint is None else checkpoint.solver
    if isinstance(solver, DirectSolver):
        return Direct(solver)
    simulated = task if solver is None else solver.task
    return Direct(DirectSolver(simulated, KeptRollouts(simulated, serial_executor())))


@dataclass(frozen=True, eq=False)
class LaplaceFit:
    """The parameters that explain the trials best, with their spread; in fractions of the margin."""

    best: Array  # (p,)
    factor: Array  # (p, p) lower Cholesky factor of the covariance

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """(n, p) draws inside of the margin."""
        drawn = self.best + rng.standard_normal((64 * n, len(self.best))) @ self.factor.T
        inside = drawn[((drawn >= 0.0) & (drawn <= 1.0)).all(axis=1)]
        return np.concatenate([inside, np.clip(drawn, 0.0, 1.0)])[:n]


@dataclass(frozen=True, eq=False)
class NearFit:
    """Trajectories of executed trials for parameters near a fit. If there is no rollout for the parameters,
    trajectories are interpolated linearly.
    """

    solver: DirectSolver
    best: Array  # (p,) in fractions of the margin

    @property
    def task(self) -> Task:
        """The task of the trials."""
        return self.solver.task

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array) -> Array:
        """(N, size); see `sim.tasks.task.Expectations`."""
        task, n = self.task, len(parameters)
        simulated_in = np.broadcast_to(task.simulated_in(context), (n, len(task.context)))
        is_known = self.solver.roll.knows(Requests(parameters, simulated_in, action, nuisance))
        around = np.vstack([self.best, self.best + _steps(self.best)])
        points, k = task.margin.denormalise(around), len(around)
        trials, which = np.unique(np.concatenate([action, context, nuisance], axis=1), axis=0, return_inverse=True)
        a, c = len(task.action), len(task.context)
        actions, contexts, drawn = (np.repeat(one, k, axis=0) for one in np.split(trials, [a, a + c], axis=1))
        paths = self.solver.trajectories(np.tile(points, (len(trials), 1)), actions, drawn, contexts)
        paths = paths.reshape(len(trials), k, -1)[which.reshape(-1)]
        slopes = (paths[:, 1:] - paths[:, :1]) / _steps(self.best).diagonal()[:, None]
        off = task.margin.normalise(parameters) - self.best
        linear = paths[:, 0] + np.einsum("np,npm->nm", off, slopes)
        if is_known.any():
            rows = np.flatnonzero(is_known)
            linear[rows] = self.solver.trajectories(parameters[rows], action[rows], nuisance[rows], context[rows])
        return np.asarray(linear)


def _steps(best: Array) -> Array:
    """(p, p) the steps of the difference quotients at a fit, which stay inside of the margin."""
    return np.diag(np.where(best + DIFFERENCE <= 1.0, DIFFERENCE, -DIFFERENCE))


@dataclass(frozen=True, eq=False)
class Direct:
    """A `Method` with `OwnPolicies`, and `Simulating`."""

    solver: DirectSolver

    @property
    def rollouts(self) -> KeptRollouts:
        """All rollouts that it has simulated."""
        return self.solver.roll

    def rollouts_before(self, particles: int) -> int:
        """The most rollouts before the first trial of a session."""
        task = self.solver.task
        return rollouts_of(task, SAMPLES) + (particles - 1) * rollouts_of(task, 1)

    def rollouts_after(self, particles: int, iteration: int) -> int:
        """The most rollouts after an iteration, from 1: a fit to all trials so far, and the next policies."""
        task = self.solver.task
        new, p = particles * task.adaptation.trials_per_iteration, len(task.parameters)
        each = particles + 1 + 2 * FEW_STEPS + 2 * p
        policies = rollouts_of(task, SCENARIOS) + (particles - 1) * rollouts_of(task, 1)
        return CLOUD * new + each * new * iteration + policies

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """All of Omega for the first particle, as in UDR, and single parameters in Omega for the others."""
        space = self.solver.task.parameters
        others = cover(space, max(n - 1, 1), rng)[: n - 1]
        everywhere = cover(space, SAMPLES, np.random.default_rng(0))
        return (Particle(everywhere), *(Particle(one[None]) for one in others))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The best fit with a few draws for the first particle, and other draws for the others."""
        fit, n = self.fit(history), len(history[-1])
        drawn = self.solver.task.margin.denormalise(np.vstack([fit.best, fit.draw(SCENARIOS + n - 2, rng)]))
        return (Particle(drawn[:SCENARIOS]), *(Particle(one[None]) for one in drawn[SCENARIOS:]))

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The policy of a particle, by true rollouts."""
        return policy_for(self.solver, particle.samples, executable)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The policy of the particle whose trials earned most."""
        return policy_for(self.solver, choose_best(self.solver.task, history).particle.samples, executable)

    def draws_after_each(self, history: Sequence[Iteration]) -> tuple[Array, ...]:
        """(DRAWS, p) equally likely parameters in units: before the first iteration, and after each."""
        margin = self.solver.task.margin
        prior = cover(margin, DRAWS, np.random.default_rng(0))
        drawn = (
            prior if fit is None else margin.denormalise(fit.draw(DRAWS, np.random.default_rng(0)))
            for fit in self._fits(history)
        )
        return (prior, *drawn)

    def fit(self, history: Sequence[Iteration]) -> LaplaceFit:
        """The fit to all trials. Raises ValueError without one."""
        *_, fit = self._fits(history) or [None]
        if fit is None:
            raise ValueError("no trial has been run yet, so nothing can be fitted")
        return fit

    def _fits(self, history: Sequence[Iteration]) -> list[LaplaceFit | None]:
        """The fit to all trials up to each iteration, None before the first trial; each begins at the one before it."""
        fits, fitted = list[LaplaceFit | None](), 0
        for k, iteration in enumerate(history, start=1):
            trials, earlier = trials_in(history[:k]), fits[-1] if fits else None
            if len(trials) == fitted:
                fits.append(earlier)
                continue
            starts = [] if earlier is None else [earlier.best]
            fits.append(self._fitted(trials, starts, [entry.particle.mean for entry in iteration]))
            fitted = len(trials)
        return fits

    def near_fit(self, history: Sequence[Iteration]) -> NearFit:
        """Expected trajectories near the fit, by the rollouts of the fit."""
        return NearFit(self.solver, self.fit(history).best)

    def _fitted(self, trials: Sequence[Trial], earlier: Sequence[Array], tried: Sequence[Array]) -> LaplaceFit:
        margin, p = self.solver.task.margin, len(self.solver.task.margin)
        box, residuals = (np.zeros(p), np.ones(p)), partial(self._residuals, trials)
        cloud = margin.normalise(cover(margin, CLOUD, np.random.default_rng(0)))
        starts = np.concatenate([cloud, margin.normalise(np.array(tried)), *(one[None] for one in earlier)])
        missed = (residuals(starts) ** 2).sum(axis=1)
        best, left = descend_with_few(residuals, starts[int(missed.argmin())], box, DIFFERENCE)
        values = VALUES * len(trials)
        variance = max(left, LEAST_LEFT**2) * values / max(values - p, 1.0)
        information = values * curvature(residuals, best, box, DIFFERENCE) / variance
        covariance = np.linalg.inv(information + 12.0 * np.eye(p))  # 1/12: the variance of the even prior
        return LaplaceFit(best, np.linalg.cholesky(covariance))

    def _residuals(self, trials: Sequence[Trial], points: Array) -> Array:
        """(N, p) -> (N, values) whose squares sum to the mean squared misfit; all trials in one set of rollouts."""
        task, (n, k) = self.solver.task, (len(points), len(trials))
        paths = self.solver.trajectories(
            np.repeat(task.margin.denormalise(points), k, axis=0),
            np.tile([trial.action for trial in trials], (n, 1)),
            np.tile(task.nuisance.middle, (n * k, 1)),
            np.tile([trial.context for trial in trials], (n, 1)),
        ).reshape(n, k, -1)
        parts = [offsets(self.solver, trial.observation, paths[:, i]) for i, trial in enumerate(trials)]
        return np.concatenate([part / max(part.shape[1] * k, 1) ** 0.5 for part in parts], axis=1)
