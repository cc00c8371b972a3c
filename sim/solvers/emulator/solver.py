"""Task policies from the emulator: the solver of every task without an exact solution.

For one distribution of parameters, the rewards of a fixed set of candidate actions are averaged over parameters,
nuisance and action error (common random numbers), with a pessimistic value over the ensemble. The best candidate is
then refined. Physics is context-free up to `Task.relocate`, so the candidates are evaluated once for all contexts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hw.types import Array, frozen_array
from sim.errors import NotExecutable
from sim.rollouts.draws import Disturbances, cover, sobol
from sim.solvers.emulator.network import Emulator
from sim.solvers.solver import Executable, SolverSettings
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class _Near:
    """Actions near a candidate, with the emulator's predictions."""

    actions: Array  # (L + 1, a)
    success: Array  # (M, L + 1, S)
    end_state: Array  # (M, L + 1, S, k)


@dataclass(frozen=True, eq=False)
class EmulatorPolicy:
    """Open loop: context -> action, for one distribution of parameters. Made by `train_many`."""

    task: Task
    emulator: Emulator
    settings: SolverSettings
    parameters: Array  # (S, p) in units; with `drawn`, the scenarios for judging every action
    drawn: Disturbances  # S of them
    candidates: Array  # (C, a) in units
    success: Array  # (M, C, S) probability
    end_state: Array  # (M, C, S, k)
    local: Array  # (L, a) normalised offsets tried around the best candidate
    executable: Executable | None = field(default=None)

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if none of the best candidates can be executed."""
        rewards = self._rewards(self.success, self.end_state, context)
        near = self._around(int(np.argmax(self._lower(rewards))))
        actions = np.concatenate([near.actions, self.candidates])
        rewards = np.concatenate([self._rewards(near.success, near.end_state, context), rewards], axis=1)
        for i in np.argsort(-self._lower(rewards), kind="stable")[: self.settings.attempts]:
            if self.executable is None or self.executable(context, actions[i]):
                return frozen_array(actions[i])
        raise NotExecutable(
            f"none of the {self.settings.attempts} best actions for context {np.round(context, 4)} lies within the "
            f"limits of the arm: move the {self.task.object_name} towards the middle of its area"
        )

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check: for training in simulation."""
        known: dict[int, _Near] = {}  # the neighbourhood of a candidate does not depend on the context
        chosen = []
        for context in contexts:
            best = int(np.argmax(self._lower(self._rewards(self.success, self.end_state, context))))
            if best not in known:
                known[best] = self._around(best)
            near = known[best]
            values = self._lower(self._rewards(near.success, near.end_state, context))
            chosen.append(near.actions[int(np.argmax(values))])
        return np.stack(chosen)

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward of this policy at `context` if its parameters are true: mean, low, high.

        Low and high are two standard deviations of the ensemble, within the possible rewards.
        """
        success, end_state = self._outcomes(self(context)[None])
        rewards = self._rewards(success, end_state, context)[:, 0]
        mean, std = float(rewards.mean()), float(rewards.std())
        return mean, max(0.0, mean - 2.0 * std), min(1.0, mean + 2.0 * std)

    def _around(self, best: int) -> _Near:
        """A candidate and the points around it."""
        space = self.task.action
        local = space.denormalise(np.clip(space.normalise(self.candidates[best]) + self.local, 0.0, 1.0))
        actions = np.concatenate([self.candidates[best][None], local])
        return _Near(actions, *self._outcomes(actions))

    def _outcomes(self, actions: Array) -> tuple[Array, Array]:
        """(A, a) -> success (M, A, S), end state (M, A, S, k)."""
        return self.emulator.outcomes(self.parameters, actions[:, None, :] + self.drawn.error, self.drawn.nuisance)

    def _rewards(self, success: Array, end_state: Array, context: Array) -> Array:
        """(M, A, S), (M, A, S, k) -> (M, A) rewards, averaged over the scenarios."""
        return np.asarray((success * self.task.reward_of_success(end_state, context)).mean(axis=-1))

    def _lower(self, rewards: Array) -> Array:
        return np.asarray(rewards.mean(axis=0) - self.settings.kappa * rewards.std(axis=0))


def train_many(
    task: Task,
    emulator: Emulator,
    samples: Array,
    rng: np.random.Generator,
    executable: Executable | None = None,
    settings: SolverSettings | None = None,
) -> tuple[EmulatorPolicy, ...]:
    """One policy for each of B distributions, samples (B, m, p) in units; the same draws for all."""
    settings = settings or SolverSettings()
    m = samples.shape[1]
    n = max(settings.scenarios, min(m, 4 * settings.scenarios))
    a = len(task.action)
    drawn = Disturbances.evenly(task, n, rng)
    candidates = cover(task.action, settings.candidates, rng)
    local = (2.0 * sobol(settings.refine, a, rng) - 1.0) * settings.candidates ** (-1.0 / a)
    policies = []
    for parameters in samples[:, np.arange(n) % m]:  # (n, p) of each
        success, end_state = emulator.outcomes(parameters, candidates[:, None, :] + drawn.error, drawn.nuisance)
        policies.append(
            EmulatorPolicy(
                task, emulator, settings, parameters, drawn, candidates, success, end_state, local, executable
            )
        )
    return tuple(policies)


@dataclass(frozen=True, eq=False)
class EmulatorSolver:
    """A `sim.solvers.solver.Solver` that queries an emulator."""

    emulator: Emulator

    @property
    def task(self) -> Task:
        """The emulator's task."""
        return self.emulator.task

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[EmulatorPolicy, ...]:
        """See `train_many`."""
        return train_many(self.task, self.emulator, samples, rng, executable, settings)

    def expected_rewards(
        self, targets: Array, contexts: Array, actions: Array, rng: np.random.Generator, draws: int = 16
    ) -> Array:
        """(B,) emulated rewards in targets (B, p) of actions (B, G, a) at contexts (G, c) or (B, G, c), averaged over
        everything but B.
        """
        drawn = Disturbances.evenly(self.task, draws, rng)
        executed = actions[:, :, None, :] + drawn.error
        success, end = self.emulator.outcomes(targets[:, None, None, :], executed, drawn.nuisance)
        rewards = success * self.task.reward_of_success(end, contexts[..., None, :])  # (M, B, G, draws)
        return np.asarray(rewards.mean(axis=(0, 2, 3)))

    def trial_rewards(self, parameters: Array, contexts: Array, action: Array, nuisance: Array) -> Array:
        """(N,) emulated rewards of N executed trials, the mean of the ensemble."""
        success, end = self.emulator.outcomes(parameters, action, nuisance)
        return np.asarray((success * self.task.reward_of_success(end, contexts)).mean(axis=0))

    def trajectories(self, parameters: Array, action: Array, nuisance: Array) -> Array:
        """(N, size), the mean of the ensemble."""
        return self.emulator.predict(parameters, action, nuisance).observation

    def outcomes(self, parameters: Array, action: Array, nuisance: Array) -> tuple[Array, Array]:
        """See `Emulator.outcomes`."""
        return self.emulator.outcomes(parameters, action, nuisance)

    @property
    def residual_std(self) -> Array:
        """(size,) robust spread of the held-out errors, normalised."""
        return self.emulator.residual_std

    @property
    def misfit_limit(self) -> float:
        """See `Emulator.misfit_limit`."""
        return self.emulator.misfit_limit
