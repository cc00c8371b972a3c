"""The predictions of a task's simulator for a session: outcomes of trials and of actions at any parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hw.types import Array
from sim.adaptation.densities import Prior
from sim.adaptation.exact_fit import exact_fit, is_exact
from sim.adaptation.method import Trial
from sim.adaptation.reward_table import RewardTable
from sim.rollouts.draws import Disturbances, cover, varies
from sim.solvers.candidates import ListedActionSolver
from sim.solvers.grid import GridSolver
from sim.solvers.misfit import log_likelihood as log_likelihood_of
from sim.solvers.misfit import observed_share, squares
from sim.tasks.task import Solver, Task

SIMULATORS = 1024
"""Number of candidate parameter vectors that fill the margin."""

DRAWS = 4
"""Draws of nuisance and action error, over which every prediction is averaged."""

LEAST_UNIT = 0.1
"""Least unit of an end-state quantity that hardly varies in the ranges, as a share of the largest unit."""


@dataclass(frozen=True)
class PartStrengths:
    """The strength of each part of the method: 1 is the method itself, and with 0, as in an ablation, the part is left
    out.
    """

    weights: float = 1.0  # power of the likelihood of trials, by which simulators are weighed
    discrepancy: float = 1.0  # factor on the scales of reality's discrepancy


@dataclass(frozen=True, eq=False)
class Predicted:
    """Predictions of K simulators for N trials, averaged over the disturbances."""

    log_likelihood: Array  # (N, K) of the trajectories
    success: Array  # (N, K)
    end: Array  # (N, K, k) in the unit of end states
    spread: Array  # (N, K, k) variance of it over the disturbances


@dataclass(frozen=True, eq=False)
class Candidates:
    """Simulators to be weighed, with their predictions for the trials so far."""

    parameters: Array  # (K, p) in units
    log_prior: Array  # (K,) of the prior over the density that proposed them
    predicted: Predicted | None  # None: no trial yet
    left: float = 1.0  # misfit left by the best simulator, as a share of the tolerated one; 1 unless it is exact


@dataclass(frozen=True, eq=False)
class Simulators:
    """The predictions of a task's simulator, shared during a session."""

    solver: Solver
    reward_table: RewardTable
    strengths: PartStrengths = PartStrengths()
    _grid: dict[bytes, Predicted] = field(default_factory=dict, repr=False)  # of `truths`, by trial

    @property
    def task(self) -> Task:
        """The solver's task."""
        return self.solver.task

    @property
    def truths(self) -> Array:
        """(T, p) candidate truths, T at most `SIMULATORS`, that follow the prior: the first ones of the table."""
        return self.reward_table.truths[:SIMULATORS]

    @property
    def refines(self) -> bool:
        """Whether there are other actions around a candidate."""
        return self.task.exact is None and not isinstance(self.solver, ListedActionSolver)

    @property
    def is_grid(self) -> bool:
        """Whether parameters are replaced by the nearest point of a coarse grid."""
        return isinstance(self.solver, ListedActionSolver) and isinstance(self.solver.behind, GridSolver)

    @cached_property
    def disturbances(self) -> Disturbances:
        """The disturbances over which every prediction is averaged."""
        return Disturbances.evenly(self.task, DRAWS if varies(self.task) else 1, np.random.default_rng(0))

    @cached_property
    def end_unit(self) -> Array:
        """(k,) standard deviation of the end states over Omega and all actions, weighted by the expected reward."""
        task, rng, n = self.task, np.random.default_rng(0), 2048
        drawn, truths = Disturbances.evenly(task, n, rng), cover(task.parameters, n, rng)
        reference = np.asarray(task.reference_context)
        others = self.actions(truths[rng.permutation(n)], n, reference)  # the best for a truth would always end alike
        contexts = task.simulated_in(cover(task.context, n, rng))
        actions = others[np.arange(n) % len(others)]
        predicted = self.solver.outcomes(truths, actions, drawn.nuisance, contexts).mean_of_ensemble
        ends, earned = predicted.end_state, predicted.success * task.reward_of_success(predicted.end_state, contexts)
        std = np.sqrt(np.cov(ends.T, aweights=earned, ddof=0).reshape(ends.shape[1], -1).diagonal()) + 1e-9
        return np.asarray(np.maximum(std, LEAST_UNIT * std.max()))

    def places(self, actions: Array, contexts: Array) -> Array:
        """(N, a), (N, c) or (c,) -> (N, d): the points between which a discrepancy varies.

        They are the actions, and the contexts where these move things, in fractions of their ranges.
        """
        moving = self.task.physical_context
        at = np.broadcast_to(contexts[..., : len(moving)], (len(actions), len(moving)))
        return np.concatenate([self.task.action.normalise(actions), moving.normalise(at)], axis=1)

    @property
    def place_size(self) -> int:
        """The number of coordinates of `places`."""
        return len(self.task.action) + len(self.task.physical_context)

    def actions(self, parameters: Array, n: int, context: Array) -> Array:
        """(A, a) candidate actions: `n` that fill their ranges; the listed ones if there are no others; for an exact
        task, the best ones for `parameters` in a context (c,), clipped to the ranges.
        """
        task = self.task
        if isinstance(self.solver, ListedActionSolver):
            return self.solver.listed
        if task.exact is None:
            return cover(task.action, n, np.random.default_rng(0))
        policies = task.exact(task).policies(parameters[:, None], np.random.default_rng(0))
        best = np.concatenate([policy.actions(task.simulated_in(context)[None]) for policy in policies])
        return np.asarray(np.clip(best, task.action.low, task.action.high))

    @property
    def prior(self) -> Prior:
        """The density of the parameters before any trial."""
        return self.reward_table.prior

    def candidates(self, trials: Sequence[Trial]) -> Candidates:
        """The simulators to weigh by trials: `truths`, or for an exact simulator those around the best fit."""
        weighs = bool(trials) and self.strengths.weights > 0.0
        if not weighs or not is_exact(self.solver):
            return Candidates(self.truths, np.zeros(len(self.truths)), self.on_grid(trials) if trials else None)
        fit = exact_fit(self.solver, trials, self.truths, self.prior)
        predicted = self.predict(trials, fit.parameters, fit.left)
        return Candidates(fit.parameters, fit.log_prior, predicted, fit.left)

    def on_grid(self, trials: Sequence[Trial]) -> Predicted:
        """Predictions of all `truths` for trials; cached per trial."""
        for trial in trials:
            if trial.key not in self._grid:
                self._grid[trial.key] = self.predict([trial], self.truths)
        parts = [self._grid[trial.key] for trial in trials]
        columns = ("log_likelihood", "success", "end", "spread")
        return Predicted(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))

    def predict(self, trials: Sequence[Trial], parameters: Array, left: float = 1.0) -> Predicted:
        """Predictions of the simulators at `parameters` (K, p) for N trials; `left` scales the tolerated misfit."""
        task, drawn = self.task, self.disturbances
        n, k, d = len(trials), len(parameters), len(drawn.error)
        shape = (n, k, d)
        where = np.broadcast_to(parameters[None, :, None], (*shape, parameters.shape[-1])).reshape(n * k * d, -1)
        commanded = np.array([trial.action for trial in trials])[:, None, None]
        executed = np.broadcast_to(commanded + drawn.error, (*shape, len(task.action))).reshape(n * k * d, -1)
        nuisance = np.broadcast_to(drawn.nuisance, (*shape, len(task.nuisance))).reshape(n * k * d, -1)
        contexts = np.repeat([trial.context for trial in trials], k * d, axis=0)
        outcomes = self.solver.outcomes(where, executed, nuisance, contexts).mean_of_ensemble
        chance = outcomes.success.reshape(shape)
        ends = np.nan_to_num(outcomes.end_state.reshape(*shape, -1) / self.end_unit)
        weight = (chance + 1e-6)[..., None]
        mean = (weight * ends).sum(axis=2) / weight.sum(axis=2)
        spread = (weight * (ends - mean[:, :, None]) ** 2).sum(axis=2) / weight.sum(axis=2)
        paths = self.solver.trajectories(where, executed, nuisance, contexts).reshape(*shape, -1)
        likely = [
            log_likelihood_of(
                squares(self.solver, trial.observation, path) / left**2,
                observed_share(trial.observation),
            )
            for trial, path in zip(trials, paths, strict=True)
        ]
        return Predicted(np.array(likely), chance.mean(axis=2), mean, spread)
