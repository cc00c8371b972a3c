"""Task policies without Phase 1: a search with true rollouts, some twenty for each of a few parameters.

The actions of a search fill their ranges, and also the contexts if these move things. Between them, the end of a trial
is interpolated. The actions that look best are then simulated too, which improves the interpolation where it matters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hw.types import Array
from sim.rollouts.draws import Disturbances, cover, physical_contexts, sobol, varies
from sim.rollouts.kept import KeptRollouts
from sim.rollouts.run import Requests
from sim.solvers.candidates import CandidatePolicy, Outcomes, first_executable
from sim.solvers.simulated import FromSimulator
from sim.tasks.task import Executable, SolverSettings, Task
from sim.types import PredictedOutcomes

SCENARIOS, VARIED = 8, 4
"""The most parameter vectors that represent a distribution, and the least number of draws if trials of one action
differ."""

BASE, PER_DIMENSION = 8, 4
"""Number of actions with which a search begins: a base number, and a number for each quantity that they fill."""

ROUNDS, ADDED = 2, 3
"""Number of rounds in which the best actions are added, and of actions in a round; each is the best in another context.
"""

APART = 0.02
"""An action is worth adding if it is at least this far from all simulated actions, in fractions of the ranges."""

CANDIDATES, AROUND = 256, 32
"""Interpolated actions among which a policy chooses, and points around the best of them."""


@dataclass(frozen=True, eq=False)
class DirectSolver(FromSimulator):
    """A `sim.solvers.solver.Solver` whose every answer is simulated."""

    task: Task
    roll: KeptRollouts
    misfit_limit: float = math.inf  # hundreds of rollouts for each trial would have to tell

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[InterpolatedPolicy, ...]:
        """One policy for each of B distributions, samples (B, m, p) in units; the same draws for all."""
        task, attempts = self.task, (settings or SolverSettings()).attempts
        count, a = scenarios_of(task, samples.shape[1]), len(task.action)
        drawn, unit = Disturbances.evenly(task, count, rng), sobol(actions_of(task), _width(task), rng)
        candidates, local = cover(task.action, CANDIDATES, rng), 2.0 * sobol(AROUND, a, rng) - 1.0
        choices = _Choices(candidates, local * CANDIDATES ** (-1.0 / a), executable, attempts)
        first = task.action.spread(unit[:, :a]), physical_contexts(task, unit[:, a:])
        sites = cover(task.context, ADDED if len(task.context) else 1, rng)
        return tuple(
            self._searched(parameters, drawn, first, choices, sites)
            for parameters in samples[:, np.arange(count) % samples.shape[1]]
        )

    def _searched(
        self, parameters: Array, drawn: Disturbances, first: tuple[Array, Array], choices: _Choices, sites: Array
    ) -> InterpolatedPolicy:
        policy = InterpolatedPolicy(self.task, choices, *first, self._simulated(parameters, drawn, *first))
        for _ in range(ROUNDS):
            new, contexts = policy.worth_adding(sites)
            if not len(new):
                break
            policy = policy.with_more(new, contexts, self._simulated(parameters, drawn, new, contexts))
        return policy

    def _simulated(self, parameters: Array, drawn: Disturbances, actions: Array, contexts: Array) -> PredictedOutcomes:
        """The outcomes (S, A) of actions (A, a) at contexts (A, c) for each of S scenarios."""
        shape = (len(parameters), len(actions))
        requests, _ = Requests.broadcast(
            parameters[:, None], contexts, actions + drawn.error[:, None], drawn.nuisance[:, None]
        )
        return self.roll(requests).outcomes(shape)


def scenarios_of(task: Task, samples: int) -> int:
    """The number of scenarios for a distribution with this number of samples."""
    return max(VARIED if varies(task) else 1, min(samples, SCENARIOS))


def actions_of(task: Task) -> int:
    """The number of actions that a search begins with."""
    return BASE + PER_DIMENSION * _width(task)


def rollouts_of(task: Task, samples: int) -> int:
    """The most rollouts for a policy of a distribution with this number of samples."""
    return scenarios_of(task, samples) * (actions_of(task) + ROUNDS * ADDED)


def _width(task: Task) -> int:
    return len(task.action) + len(task.physical_context)


def _followed_by(first: PredictedOutcomes, then: PredictedOutcomes) -> PredictedOutcomes:
    """The outcomes (S, A) of some actions, and those of others."""
    failed = None
    if first.failure_reward is not None and then.failure_reward is not None:
        failed = np.concatenate([first.failure_reward, then.failure_reward], axis=1)
    return PredictedOutcomes(
        np.concatenate([first.success, then.success], axis=1),
        np.concatenate([first.end_state, then.end_state], axis=1),
        failed,
    )


@dataclass(frozen=True, eq=False)
class _Choices:
    """The actions that a policy chooses among."""

    candidates: Array  # (C, a) in units
    local: Array  # (L, a) from the best candidate to points around it, in fractions of ranges
    executable: Executable | None
    attempts: int


@dataclass(frozen=True, eq=False)
class InterpolatedPolicy(CandidatePolicy):
    """A `SolvedPolicy` that interpolates between simulated actions, in each scenario separately."""

    of_task: Task
    choices: _Choices
    simulated: Array  # (A, a) in units
    contexts: Array  # (A, c) in which each was simulated
    ends: PredictedOutcomes  # (S, A) of the simulated actions
    _near: dict[tuple[bytes, int], Outcomes] = field(default_factory=dict, repr=False)
    _everywhere: dict[bytes, Outcomes] = field(default_factory=dict, repr=False)

    @property
    def task(self) -> Task:
        """The task of the policy."""
        return self.of_task

    def __call__(self, context: Array) -> Array:
        """(c,) -> (a,). Raises NotExecutable if none of the best candidates can be executed."""
        executable, attempts = self.choices.executable, self.choices.attempts
        return first_executable(*self.ranked(context), context, executable, self.task, attempts)

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of its action at `context`; low and high are two standard deviations of the scenarios."""
        rewards = self._rewards(self.outcomes(self(context)[None], context), context)[0]
        mean, std = float(rewards.mean()), float(rewards.std())
        return mean, max(0.0, mean - 2.0 * std), min(1.0, mean + 2.0 * std)

    def everywhere(self, context: Array) -> Outcomes:
        """The outcomes of all candidates, and of the simulated actions where these do not depend on a context."""
        key = self.task.simulated_in(context).tobytes()
        if key not in self._everywhere:
            more = self.simulated if not len(self.task.physical_context) else self.simulated[:0]
            self._everywhere[key] = self.outcomes(np.concatenate([more, self.choices.candidates]), context)
        return self._everywhere[key]

    def steps(self) -> Array | None:
        """(L, a)"""
        return self.choices.local

    def outcomes(self, actions: Array, context: Array) -> Outcomes:
        """(A, S): success is that of the nearest simulated action, and the end state is interpolated."""
        at = self._coordinates(actions, np.broadcast_to(self.task.simulated_in(context), (len(actions), len(context))))
        near = np.linalg.norm(at[:, None] - self._places, axis=-1).argmin(axis=1)
        ends = np.stack([interpolant(at) for interpolant in self._interpolants], axis=1)
        failed = None if self.ends.failure_reward is None else self.ends.failure_reward[:, near].T
        return Outcomes(self.task, actions, PredictedOutcomes(self.ends.success[:, near].T, ends, failed))

    def worth(self, outcomes: Outcomes, context: Array) -> Array:
        """(A,) mean rewards over the scenarios."""
        return np.asarray(self._rewards(outcomes, context).mean(axis=-1))

    def worth_adding(self, sites: Array) -> tuple[Array, Array]:
        """(N, a) actions that look best at `sites` (G, c) and are not simulated yet, and (N, c) where to simulate."""
        actions, contexts = list[Array](), list[Array]()
        places = self._places
        for context in sites:
            ranked, worth = self.ranked(context)
            at = self.task.simulated_in(context)
            for action in ranked[np.argsort(-worth, kind="stable")]:
                place = self._coordinates(action[None], at[None])
                if len(actions) < ADDED and np.linalg.norm(places - place, axis=1).min() > APART:
                    actions.append(action)
                    contexts.append(at)
                    places = np.concatenate([places, place])
                    if len(sites) > 1:
                        break
        shape = (len(actions), len(self.task.context))
        return np.array(actions).reshape(len(actions), len(self.task.action)), np.array(contexts).reshape(shape)

    def with_more(self, actions: Array, contexts: Array, ends: PredictedOutcomes) -> InterpolatedPolicy:
        """The policy with further simulated actions."""
        return InterpolatedPolicy(
            self.task,
            self.choices,
            np.concatenate([self.simulated, actions]),
            np.concatenate([self.contexts, contexts]),
            _followed_by(self.ends, ends),
        )

    def _rewards(self, outcomes: Outcomes, context: Array) -> Array:
        """(A, S)"""
        return self.task.expected_reward(outcomes.predicted, context)

    def _coordinates(self, actions: Array, contexts: Array) -> Array:
        moving = self.task.physical_context
        parts = [self.task.action.normalise(actions), moving.normalise(contexts[:, : len(moving)])]
        return np.concatenate(parts, axis=1)

    @cached_property
    def _places(self) -> Array:
        return self._coordinates(self.simulated, self.contexts)

    @cached_property
    def _interpolants(self) -> tuple[_Interpolant, ...]:
        of_scenarios = zip(self.ends.success > 0.0, self.ends.end_state, strict=True)
        return tuple(_Interpolant(self._places[good], end[good]) for good, end in of_scenarios)


class _Interpolant:
    """A thin plate through values at places, with a linear trend; the nearest value where there are too few of them."""

    def __init__(self, places: Array, values: Array) -> None:
        from scipy.interpolate import RBFInterpolator  # noqa: PLC0415 - slow to import

        self._places, first = np.unique(places.round(9), axis=0, return_index=True)
        self._values = values[first]
        self._smooth = None
        spread = self._places - self._places.mean(axis=0) if len(first) else self._places
        if len(first) > places.shape[1] + 1 and np.linalg.matrix_rank(spread) == places.shape[1]:
            self._smooth = RBFInterpolator(self._places, self._values, kernel="thin_plate_spline")

    def __call__(self, at: Array) -> Array:
        """(N, d) -> (N, k); zeros if nothing is known."""
        if self._smooth is not None:
            return np.asarray(self._smooth(at))
        if not len(self._places):
            return np.zeros((len(at), self._values.shape[1]))
        near = np.linalg.norm(at[:, None] - self._places, axis=-1).argmin(axis=1)
        return np.asarray(self._values[near])
