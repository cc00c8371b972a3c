"""Policies that choose among candidate actions by expected reward; and a solver for which only listed actions exist.

The outcomes of the candidates are kept for each context in which rollouts are simulated (`Task.simulated_in`). With
`Task.relocate` there is only one such context, so the outcomes serve all contexts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array, frozen_array
from sim.errors import NotExecutable
from sim.rollouts.draws import Disturbances, cover, sobol, varies
from sim.solvers.interior import prefer_interior
from sim.tasks.task import Executable, Expectations, SolvedPolicy, Solver, SolverSettings, Task
from sim.types import PredictedOutcomes


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Predicted outcomes of A actions. The last axis of a chance runs over disturbances or scenarios, over which
    rewards are averaged.
    """

    task: Task
    actions: Array  # (A, a) in units
    predicted: PredictedOutcomes  # (..., S)

    def rewards(self, context: Array) -> Array:
        """(...,) expected rewards in one context."""
        return np.asarray(self.task.expected_reward(self.predicted, context).mean(axis=-1))


def first_executable(
    actions: Array, worth: Array, context: Array, executable: Executable | None, task: Task, attempts: int | None
) -> Array:
    """The first executable one of the actions (A, a), in the order of falling worth (A,). With `attempts` None, no
    other actions exist.

    Raises NotExecutable.
    """
    for i in np.argsort(-worth, kind="stable")[:attempts]:
        if executable is None or executable(context, actions[i]):
            return frozen_array(actions[i])
    if attempts is None:
        raise NotExecutable(
            f"none of the {len(actions)} listed actions can still be executed for context "
            f"{np.round(context, 4)}: end the session here, or list more actions"
        )
    raise NotExecutable(
        f"none of the {attempts} best actions for context {np.round(context, 4)} lies within the limits of the arm: "
        f"move the {task.object_name} towards the middle of its area"
    )


class CandidatePolicy(ABC):
    """A `SolvedPolicy`: the candidate with the highest value, or a point around it with a higher one."""

    _near: dict[tuple[bytes, int], Outcomes]  # a candidate and the points around it, by `simulated_in`

    @property
    @abstractmethod
    def task(self) -> Task:
        """The task of the policy."""

    @abstractmethod
    def everywhere(self, context: Array) -> Outcomes:
        """The outcomes of all candidates in a context (c,)."""

    @abstractmethod
    def steps(self) -> Array | None:
        """(L, a) offsets from the best candidate to the points around it, in fractions of ranges; None if there are no
        such points.
        """

    @abstractmethod
    def outcomes(self, actions: Array, context: Array) -> Outcomes:
        """The outcomes of actions (A, a) in a context (c,)."""

    @abstractmethod
    def worth(self, outcomes: Outcomes, context: Array) -> Array:
        """(A,) the values by which actions are chosen."""

    @property
    def prefers_interior(self) -> bool:
        """Whether the surroundings of actions decide between those of almost equal value (`sim.solvers.interior`)."""
        return False

    def ranked(self, context: Array) -> tuple[Array, Array]:
        """The actions to choose from at `context` (c,) and their values; the refined ones come first."""
        everywhere = self.everywhere(context)
        worth = self.worth(everywhere, context)
        preference = self._preference(everywhere.actions, worth, everywhere, worth)
        near = self._around(int(np.argmax(preference)), context)
        if near is None:
            return everywhere.actions, preference
        actions = np.concatenate([near.actions, everywhere.actions])
        refined = np.concatenate([self.worth(near, context), worth])
        return actions, self._preference(actions, refined, everywhere, worth)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check."""
        ranks = (self.ranked(context) for context in contexts)
        return np.stack([actions[int(np.argmax(value))] for actions, value in ranks])

    def _preference(self, actions: Array, worth: Array, everywhere: Outcomes, everywhere_worth: Array) -> Array:
        if not self.prefers_interior:
            return worth
        space = self.task.action
        even = space.normalise(everywhere.actions)
        return prefer_interior(space.normalise(actions), worth, even, everywhere_worth)

    def _around(self, best: int, context: Array) -> Outcomes | None:
        key = (self.task.simulated_in(context).tobytes(), best)
        if key not in self._near and (steps := self.steps()) is not None:
            space, winner = self.task.action, self.everywhere(context).actions[best]
            near = space.denormalise(np.clip(space.normalise(winner) + steps, 0.0, 1.0))
            self._near[key] = self.outcomes(np.concatenate([winner[None], near]), context)
        return self._near.get(key)


@dataclass(frozen=True, eq=False)
class ScenarioPolicy(CandidatePolicy):
    """The action with the highest pessimistic reward over scenarios of parameters and disturbances."""

    expectations: Expectations
    settings: SolverSettings
    parameters: Array  # (S, p) in units; with `drawn`, the scenarios for judging every action
    drawn: Disturbances  # S of them
    candidates: Array  # (C, a) in units
    local: Array | None  # (L, a), see `steps`; None: only the candidates exist
    executable: Executable | None = None
    _near: dict[tuple[bytes, int], Outcomes] = field(default_factory=dict, repr=False)
    _everywhere: dict[bytes, Outcomes] = field(default_factory=dict, repr=False)  # by `simulated_in`

    @property
    def task(self) -> Task:
        """The task of its expectations."""
        return self.expectations.task

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if no action is left, or none of the best ones can be
        executed.
        """
        attempts = None if self.local is None else self.settings.attempts
        return first_executable(*self.ranked(context), context, self.executable, self.expectations.task, attempts)

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of its action if its parameters are true: mean, low, high.

        Low and high are two standard deviations of the ensemble, within the possible rewards.
        """
        action = self(context)
        if self.local is None:
            at = int(np.flatnonzero((self.candidates == action).all(axis=1))[0])
            rewards = self.everywhere(context).rewards(context)[:, at]
        else:
            rewards = self.outcomes(action[None], context).rewards(context)[:, 0]
        mean, std = float(rewards.mean()), float(rewards.std())
        return mean, max(0.0, mean - 2.0 * std), min(1.0, mean + 2.0 * std)

    @property
    def prefers_interior(self) -> bool:
        """True if the physics is not known, that is for a distribution wider than a point; never for listed actions."""
        return self.local is not None and bool(np.ptp(self.parameters, axis=0).any())

    def steps(self) -> Array | None:
        """(L, a), or None."""
        return self.local

    def everywhere(self, context: Array) -> Outcomes:
        """Success (M, C, S) and end state (M, C, S, k) of the candidates."""
        key = self.task.simulated_in(context).tobytes()
        if key not in self._everywhere:
            self._everywhere[key] = self.outcomes(self.candidates, context)
        return self._everywhere[key]

    def outcomes(self, actions: Array, context: Array) -> Outcomes:
        """Success (M, A, S) and end state (M, A, S, k)."""
        executed = actions[:, None, :] + self.drawn.error
        predicted = self.expectations.outcomes(self.parameters, executed, self.drawn.nuisance, context)
        return Outcomes(self.expectations.task, actions, predicted)

    def worth(self, outcomes: Outcomes, context: Array) -> Array:
        """(A,) the mean reward of the ensemble minus `kappa` standard deviations."""
        rewards = outcomes.rewards(context)
        lower = np.asarray(rewards.mean(axis=0) - self.settings.kappa * rewards.std(axis=0))
        return lower.round(9) if self.local is None else lower


def search(
    expectations: Expectations,
    samples: Array,
    rng: np.random.Generator,
    executable: Executable | None = None,
    settings: SolverSettings | None = None,
    listed: Array | None = None,
) -> tuple[ScenarioPolicy, ...]:
    """One policy for each of B distributions, samples (B, m, p) in units; the same draws for all.

    With `listed` (A, a), no other actions exist; otherwise candidates fill their ranges, and the best one is refined.
    """
    task, settings, m = expectations.task, settings or SolverSettings(), samples.shape[1]
    n = max(settings.scenarios if varies(task) else 1, min(m, 4 * settings.scenarios))
    drawn, candidates, local = Disturbances.evenly(task, n, rng), listed, None
    if candidates is None:
        a = len(task.action)
        candidates = cover(task.action, settings.candidates, rng)
        local = (2.0 * sobol(settings.refine, a, rng) - 1.0) * settings.candidates ** (-1.0 / a)
    return tuple(
        ScenarioPolicy(expectations, settings, parameters, drawn, candidates, local, executable)
        for parameters in samples[:, np.arange(n) % m]
    )


class FromOutcomes(ABC):
    """Expected rewards of a solver whose `outcomes` cost next to nothing; see `sim.tasks.task.Expectations`."""

    task: Task

    @abstractmethod
    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """See `sim.tasks.task.Expectations`."""

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """(B,) rewards in targets (B, p) of actions (B, G, a) at contexts (G, c) or (B, G, c), averaged over everything
        but B.
        """
        drawn = Disturbances.evenly(self.task, draws if varies(self.task) else 1, rng)
        executed = actions[:, :, None, :] + drawn.error
        predicted = self.outcomes(targets[:, None, None, :], executed, drawn.nuisance, contexts[..., None, :])
        rewards = self.task.expected_reward(predicted, contexts[..., None, :])  # (M, B, G, draws)
        return np.asarray(rewards.mean(axis=(0, 2, 3)))

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,) rewards of N executed trials, the mean of the ensemble."""
        predicted = self.outcomes(parameters, action, nuisance, contexts)
        return np.asarray(self.task.expected_reward(predicted, contexts).mean(axis=0))


@dataclass(frozen=True, eq=False)
class PredictionsBehind(FromOutcomes):
    """A solver with a task of its own, whose predictions are those of another one behind it."""

    task: Task
    behind: Expectations

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.trajectories(parameters, action, nuisance, context)

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.outcomes(parameters, action, nuisance, context)

    @property
    def residual_std(self) -> Array:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.residual_std

    @property
    def misfit_limit(self) -> float:
        """See `sim.tasks.task.Expectations`."""
        return self.behind.misfit_limit


@dataclass(frozen=True, eq=False)
class ListedActionSolver(PredictionsBehind):
    """A `Solver` with the actions (A, a), in units, that were recorded or that a search tries."""

    listed: Array

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[SolvedPolicy, ...]:
        """One policy for each of B distributions, samples (B, m, p) in units; the same draws for all."""
        return search(self.behind, samples, rng, executable, settings, self.listed)


def with_listed_actions(solver: Solver, listed: Array) -> ListedActionSolver:
    """The solver for which only the actions (A, a) exist."""
    behind = solver.behind if isinstance(solver, ListedActionSolver) else solver
    return ListedActionSolver(solver.task, behind, frozen_array(listed, (None, None), "actions"))
