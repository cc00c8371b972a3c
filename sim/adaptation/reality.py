"""The knowledge of a session about reality: candidate simulators, and the discrepancy of reality from each.

1. A *simulator* is the emulator at one set of parameters. Each trial weighs it: by its trajectory, by whether it
   succeeded, and by where a success ended.
2. No parameters describe reality exactly. Its discrepancy in the chance of success and in the end state is a smooth
function of the action, and of a context that moves things (`Discrepancy`). It explains a residual that several trials
share; only the unexplained rest weighs simulators.
3. Many pairs of a simulator and such functions are drawn. Each predicts the reward of any action in any context;
together they give the expected reward and its uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from hw.types import Array, frozen_array
from sim.adaptation.method import Trial
from sim.adaptation.reward_table import RewardTable
from sim.rollouts.draws import Disturbances, cover, sobol, varies
from sim.solvers.candidates import CandidatePolicy, ListedActionSolver, Outcomes, first_executable
from sim.solvers.grid import GridSolver
from sim.solvers.misfit import log_likelihood, observed_share, squares
from sim.solvers.solver import Executable, Solver
from sim.tasks.task import Task

SIMULATORS, KEPT = 1024, 48
"""Number of candidate parameter vectors, and number of draws from them."""

DRAWS = 4
"""Draws of nuisance and action error, over which every prediction is averaged."""

ACTIONS, REFINED = 256, 16
"""Number of actions that fill their ranges, and number of those around the best one."""

LENGTH = 0.3
"""Distance, in fractions of the actions' ranges, over which a discrepancy varies."""

FREEDOM = 4.0
"""Degrees of freedom of Student's t for residuals, so that one outlier does not outweigh all others."""

FEATURES = 256
"""Number of cosines in a drawn function."""


@dataclass(frozen=True)
class DiscrepancyScale:
    """Standard deviations of a discrepancy before any trial."""

    level: float  # the same for all actions
    local: float  # varies over `LENGTH`

    def times(self, factor: float) -> DiscrepancyScale:
        """The two scales, multiplied."""
        return DiscrepancyScale(self.level * factor, self.local * factor)

    def kernel(self, a: Array, b: Array) -> Array:
        """(A, d), (B, d) in fractions of ranges -> (A, B) covariances."""
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
        return np.asarray(self.level**2 + self.local**2 * np.exp(-0.5 * squared / LENGTH**2))


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """One discrepancy between reality and a simulator, conditioned on residuals: observations of trials minus
    predictions. A smooth function of the action, a Gaussian process (Kennedy & O'Hagan 2001).

    A misaligned mount, a bent blade or a tilted table has the same effect on similar actions. So a residual of a trial
    is expected of nearby actions too, and less so the farther away they are. See `Simulators.places`.

    Actions and noise of the trials are the same for every candidate simulator, so all are conditioned at once:
    Rasmussen & Williams 2006, eq. 2.30.
    """

    scale: DiscrepancyScale
    at: Array  # (N, d) `Simulators.places` of the trials
    noise: Array  # (N,) variance of each residual

    def evidence(self, residuals: Array) -> Array:
        """(N, K) residuals of K simulators -> (K,) log-evidence, up to a constant common to all scales."""
        if not len(self.at):
            return np.zeros(residuals.shape[1])
        volume = np.log(self._factor[0].diagonal()).sum()
        squared = (residuals * cho_solve(self._factor, residuals)).sum(axis=0)
        return np.asarray(-0.5 * (FREEDOM + len(self.at)) * np.log1p(squared / FREEDOM) - volume)

    def drawn(self, actions: Array, residuals: Array, seed: int) -> Array:
        """(A, d), (N, K) -> (A, K): one function drawn for each simulator; the same seed gives the same functions.

        A draw from the prior, corrected by its error at the trials (Wilson et al. 2020, eq. 13).
        """
        rng, k = np.random.default_rng(seed), residuals.shape[1]
        weights, d = rng.standard_normal((1 + FEATURES, k)), actions.shape[1]
        waves, phases = rng.standard_normal((d, FEATURES)) / LENGTH, 2.0 * np.pi * rng.random(FEATURES)

        def before(at: Array) -> Array:
            local = np.cos(at @ waves + phases) * (2.0 / FEATURES) ** 0.5  # Rahimi & Recht 2007
            return np.asarray(self.scale.level * weights[0] + self.scale.local * local @ weights[1:])

        if not len(self.at):
            return before(actions)
        error = self.noise[:, None] ** 0.5 * rng.standard_normal((len(self.at), k))
        missed = residuals - before(self.at) - error
        return np.asarray(before(actions) + self.scale.kernel(actions, self.at) @ cho_solve(self._factor, missed))

    @cached_property
    def _factor(self) -> tuple[Array, bool]:
        factor: tuple[Array, bool] = cho_factor(self.scale.kernel(self.at, self.at) + np.diag(self.noise))
        return factor


SUCCESS = DiscrepancyScale(level=0.1, local=0.25)
"""Prior scale of the discrepancy in the chance of success."""

END = DiscrepancyScale(level=0.1, local=0.15)
"""Prior scale of the discrepancy in the end state, in standard deviations of the end states in the ranges."""

FACTORS, FACTORS_STD = (0.5, 1.0, 2.0, 4.0), 1.0
"""Factors of the two scales are fitted to the trials; the second is the prior standard deviation of their logarithms.
"""

LEAST_UNIT = 0.1
"""Least unit of an end-state quantity that hardly varies in the ranges, as a share of the largest unit."""

LEAST_CHANCE_STD, LEAST_END_STD = 0.22, 0.02
"""Noise of a single success and of a single end state, besides the disturbances."""


@dataclass(frozen=True, eq=False)
class _Predicted:
    """Predictions of K simulators for N trials, averaged over the disturbances."""

    log_likelihood: Array  # (N, K) of the trajectories
    success: Array  # (N, K)
    end: Array  # (N, K, k) in the unit of end states
    spread: Array  # (N, K, k) variance of it over the disturbances


@dataclass(frozen=True, eq=False)
class Simulators:
    """The predictions of a task's simulator, shared during a session."""

    solver: Solver
    prospects: RewardTable
    _grid: dict[bytes, _Predicted] = field(default_factory=dict, repr=False)  # of `truths`, by trial

    @property
    def task(self) -> Task:
        """The solver's task."""
        return self.solver.task

    @property
    def truths(self) -> Array:
        """(T, p) candidate truths, T at most `SIMULATORS`, that fill Omega and its margin: the first ones of the
        prospects.
        """
        return self.prospects.truths[:SIMULATORS]

    @property
    def refines(self) -> bool:
        """Whether there are other actions around a candidate."""
        return self.task.exact is None and not isinstance(self.solver, ListedActionSolver)

    @property
    def is_grid(self) -> bool:
        """Whether any parameters count as the nearest point of a coarse grid."""
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
        success, end = self.solver.outcomes(truths, others[np.arange(n) % len(others)], drawn.nuisance, contexts)
        ends = end.mean(axis=0)
        earned = success.mean(axis=0) * task.reward_of_success(ends, contexts)
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
        task, the best ones for `parameters` in a context (c,).
        """
        task = self.task
        if isinstance(self.solver, ListedActionSolver):
            return self.solver.listed
        if task.exact is None:
            return cover(task.action, n, np.random.default_rng(0))
        policies = task.exact(task).policies(parameters[:, None], np.random.default_rng(0))
        return np.concatenate([policy.actions(task.simulated_in(context)[None]) for policy in policies])

    def on_grid(self, trials: Sequence[Trial]) -> _Predicted:
        """Predictions of all `truths` for trials; cached per trial."""
        for trial in trials:
            if trial.key not in self._grid:
                self._grid[trial.key] = self.predict([trial], self.truths)
        parts = [self._grid[trial.key] for trial in trials]
        columns = ("log_likelihood", "success", "end", "spread")
        return _Predicted(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))

    def predict(self, trials: Sequence[Trial], parameters: Array) -> _Predicted:
        """Predictions of the simulators at `parameters` (K, p) for N trials."""
        task, drawn = self.task, self.disturbances
        n, k, d = len(trials), len(parameters), len(drawn.error)
        shape = (n, k, d)
        where = np.broadcast_to(parameters[None, :, None], (*shape, parameters.shape[-1])).reshape(n * k * d, -1)
        commanded = np.array([trial.action for trial in trials])[:, None, None]
        executed = np.broadcast_to(commanded + drawn.error, (*shape, len(task.action))).reshape(n * k * d, -1)
        nuisance = np.broadcast_to(drawn.nuisance, (*shape, len(task.nuisance))).reshape(n * k * d, -1)
        contexts = np.repeat([trial.context for trial in trials], k * d, axis=0)
        success, end = self.solver.outcomes(where, executed, nuisance, contexts)
        chance = success.mean(axis=0).reshape(shape)
        ends = np.nan_to_num(end.mean(axis=0).reshape(*shape, -1) / self.end_unit)
        weight = (chance + 1e-6)[..., None]
        mean = (weight * ends).sum(axis=2) / weight.sum(axis=2)
        spread = (weight * (ends - mean[:, :, None]) ** 2).sum(axis=2) / weight.sum(axis=2)
        paths = self.solver.trajectories(where, executed, nuisance, contexts).reshape(*shape, -1)
        likely = [
            log_likelihood(squares(self.solver, trial.observation, path), observed_share(trial.observation))
            for trial, path in zip(trials, paths, strict=True)
        ]
        return _Predicted(np.array(likely), chance.mean(axis=2), mean, spread)


@dataclass(frozen=True, eq=False)
class Reality:
    """Possible realities after some trials: `KEPT` equally likely draws of a simulator and its discrepancies."""

    simulators: Simulators
    trials: tuple[Trial, ...]
    _answers: dict[bytes, Outcomes] = field(default_factory=dict, repr=False)  # by `Task.simulated_in`

    @cached_property
    def weights(self) -> Array:
        """(T,) probabilities of `Simulators.truths`: their posterior; the prior is uniform over the margin.

        No point of a grid is the truth, and a point is as wrong in every trial: together they count as one on average.
        """
        if not self.trials:
            return np.full(len(self.simulators.truths), 1.0 / len(self.simulators.truths))
        predicted = self._on_average
        log = predicted.log_likelihood.sum(axis=0) + self._success.evidence(self._missed(predicted))
        for discrepancy, residuals in zip(self._ends, self._off(predicted), strict=True):
            log = log + discrepancy.evidence(residuals)
        return _weights(log / len(self.trials) if self.simulators.is_grid else log)

    @cached_property
    def parameters(self) -> Array:
        """(KEPT, p) parameters of the drawn simulators, in units."""
        places = (np.arange(KEPT) + 0.5) / KEPT
        drawn = np.minimum(np.searchsorted(np.cumsum(self.weights), places), len(self.weights) - 1)
        return frozen_array(self.simulators.truths[drawn])

    def answers(self, context: Array) -> Outcomes:
        """The outcomes of candidate actions in a context (c,). In every context there are equally many candidates."""
        key = self.simulators.task.simulated_in(context).tobytes()
        if key not in self._answers:
            best_for = np.concatenate([self.parameters, self.simulators.prospects.candidates])
            self._answers[key] = self.answers_to(self.simulators.actions(best_for, ACTIONS, context), context)
        return self._answers[key]

    def answers_to(self, actions: Array, context: Array) -> Outcomes:
        """(A, a) in units -> their outcomes in every draw: success (A, KEPT, D), end state (A, KEPT, D, k)."""
        task, drawn, unit = self.simulators.task, self.simulators.disturbances, self.simulators.end_unit
        success, end = self.simulators.solver.outcomes(
            self.parameters[None, :, None], actions[:, None, None] + drawn.error, drawn.nuisance, context
        )
        at = self.simulators.places(actions, context)
        added = [discrepancy.drawn(at, residuals, seed) for seed, (discrepancy, residuals) in enumerate(self._added)]
        chance = np.clip(success.mean(axis=0) + added[0][..., None], 0.0, 1.0)
        off = np.stack(added[1:], axis=-1) * unit
        return Outcomes(task, actions, chance, end.mean(axis=0) + off[:, :, None])

    @cached_property
    def _added(self) -> list[tuple[Discrepancy, Array]]:
        """The conditioned discrepancies in the chance of success and in each end-state quantity."""
        if not self.trials:
            d, k = self.simulators.place_size, len(self.simulators.end_unit)
            nothing = [Discrepancy(scale, np.zeros((0, d)), np.zeros(0)) for scale in (SUCCESS, *[END] * k)]
            return [(unknown, np.zeros((0, KEPT))) for unknown in nothing]
        predicted = self.simulators.predict(self.trials, self.parameters)
        ends = zip(self._ends, self._off(predicted), strict=True)
        return [(self._success, self._missed(predicted)), *ends]

    def _missed(self, predicted: _Predicted) -> Array:
        """(N, K) observed success minus predicted chance."""
        return self._succeeded[:, None] - predicted.success

    def _off(self, predicted: _Predicted) -> list[Array]:
        """Observed minus predicted end states, (successes, K) for each quantity."""
        shown = np.array([t.end_state for t in self.trials if t.end_state is not None]).reshape(-1, self._k)
        residuals = shown[:, None] / self.simulators.end_unit - predicted.end[self._succeeded]
        return [residuals[..., axis] for axis in range(self._k)]

    @cached_property
    def _success(self) -> Discrepancy:
        """The discrepancy in the chance of success."""
        expected = self._on_average.success @ self._by_path
        noise = expected * (1.0 - expected) + LEAST_CHANCE_STD**2
        return self._likeliest(SUCCESS, self._at, noise, self._missed(self._on_average))

    @cached_property
    def _ends(self) -> list[Discrepancy]:
        """The discrepancy in each end-state quantity."""
        spread = np.einsum("nkd,k->nd", self._on_average.spread[self._succeeded], self._by_path) + LEAST_END_STD**2
        at, off = self._at[self._succeeded], self._off(self._on_average)
        return [self._likeliest(END, at, spread[:, axis], off[axis]) for axis in range(self._k)]

    def _likeliest(self, scale: DiscrepancyScale, at: Array, noise: Array, residuals: Array) -> Discrepancy:
        """The discrepancy with the multiple of `scale` that best explains residuals (N, T) over all simulators
        (empirical Bayes).
        """
        candidates = [Discrepancy(scale.times(factor), at, noise) for factor in FACTORS]
        paths = self._on_average.log_likelihood.sum(axis=0)
        explained = [logsumexp(paths + one.evidence(residuals)) for one in candidates]
        before = -0.5 * (np.log(FACTORS) / FACTORS_STD) ** 2
        return candidates[int(np.argmax(explained + before))]

    @cached_property
    def _on_average(self) -> _Predicted:
        return self.simulators.on_grid(self.trials)

    @cached_property
    def _by_path(self) -> Array:
        """(T,) weights by the trajectories only; the noise of trials is averaged with them."""
        return _weights(self._on_average.log_likelihood.sum(axis=0))

    @cached_property
    def _at(self) -> Array:
        actions, contexts = (np.array([getattr(t, name) for t in self.trials]) for name in ("action", "context"))
        return self.simulators.places(actions, contexts)

    @cached_property
    def _succeeded(self) -> Array:
        return np.array([t.end_state is not None for t in self.trials])

    @property
    def _k(self) -> int:
        return len(self.simulators.end_unit)


@dataclass(frozen=True, eq=False)
class RealityPolicy(CandidatePolicy):
    """A `SolvedPolicy`: the action with the highest expected reward plus `optimism` standard deviations."""

    reality: Reality
    optimism: float = 0.0
    executable: Executable | None = None
    attempts: int = 64
    _near: dict[tuple[bytes, int], Outcomes] = field(default_factory=dict, repr=False)

    @property
    def task(self) -> Task:
        """The task of the simulators."""
        return self.reality.simulators.task

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if none of the best actions can be executed."""
        attempts = self.attempts if self.reality.simulators.refines else None
        return first_executable(*self.ranked(context), context, self.executable, self.task, attempts)

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of the action at `context`: mean, and the 95 % interval over the draws."""
        earned = self.outcomes(self(context)[None], context).rewards(context)[0]
        low, high = np.quantile(earned, [0.025, 0.975])
        return float(earned.mean()), float(low), float(high)

    def everywhere(self, context: Array) -> Outcomes:
        """The outcomes of the candidate actions."""
        return self.reality.answers(context)

    def steps(self) -> Array:
        """(REFINED, a); none if there are no other actions."""
        a = len(self.task.action)
        around = (2.0 * sobol(REFINED, a, np.random.default_rng(0)) - 1.0) * ACTIONS ** (-1.0 / a)
        return np.asarray(around if self.reality.simulators.refines else around[:0])

    def outcomes(self, actions: Array, context: Array) -> Outcomes:
        """The outcomes of actions (A, a) in every draw."""
        return self.reality.answers_to(actions, context)

    def worth(self, outcomes: Outcomes, context: Array) -> Array:
        """(A,) rounded, so that equal actions tie."""
        earned = outcomes.rewards(context)
        return np.asarray(np.round(earned.mean(axis=1) + self.optimism * earned.std(axis=1), 9))


def _weights(log: Array) -> Array:
    likely = np.exp(log - log.max())
    return np.asarray(likely / likely.sum())
