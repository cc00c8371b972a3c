"""Task policies whose winners are simulated before they are executed.

An emulator knows the best actions roughly; which of the few best is best, and whether they are any good, a handful of
true rollouts tells. Both are pooled: the emulator counts as so many rollouts as its own error is worth.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hw.types import Array, frozen_array
from sim.rollouts.run import Requests, Roll
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.solver import EmulatorPolicy, train_many
from sim.solvers.solver import Executable, SolverSettings
from sim.tasks.task import Task

WINNERS = 4
"""Actions that are simulated for a context: the best that lie apart and can be executed."""

SCENARIOS = 8
"""Rollouts of each: the first of the scenarios that the emulator judged it by."""

EMULATOR_WORTH = 10.0
"""Rollouts that the emulator's expectation of an action counts as, if its mean reward is off by .15 (assumed, not
measured): that of n rollouts that succeed or fail is off by .5 / sqrt(n)."""


@dataclass(frozen=True, eq=False)
class ConfirmedPolicy:
    """A `SolvedPolicy`: that of the emulator, its winners at each context simulated in the distribution it is for."""

    policy: EmulatorPolicy
    roll: Roll
    known: dict[bytes, tuple[Array, float, float]] = field(default_factory=dict)  # context -> action, reward, its std

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable, RolloutError."""
        return self._confirmed(context)[0]

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), unconfirmed: for training in simulation."""
        return self.policy.actions(contexts)

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Expected reward at `context`, were the parameters true: mean, low, high (two standard deviations)."""
        _, mean, std = self._confirmed(context)
        return mean, max(0.0, mean - 2.0 * std), min(1.0, mean + 2.0 * std)

    def _confirmed(self, context: Array) -> tuple[Array, float, float]:
        key = np.ascontiguousarray(context).tobytes()
        if key not in self.known:
            actions, expected = self.policy.shortlist(context, WINNERS)
            true = self._simulated(actions, context)
            n = true.shape[1]
            pooled = (EMULATOR_WORTH * expected + n * true.mean(axis=1)) / (EMULATOR_WORTH + n)
            best = int(np.argmax(pooled))
            std = float(np.sqrt(max(pooled[best] * (1.0 - pooled[best]), 0.0) / (EMULATOR_WORTH + n)))
            self.known[key] = frozen_array(actions[best]), float(pooled[best]), std
        return self.known[key]

    def _simulated(self, actions: Array, context: Array) -> Array:
        """(W, a) -> (W, S) true rewards, every action in the same scenarios."""
        task, drawn = self.policy.task, self.policy.drawn
        parameters, nuisance, error = (
            rows[:SCENARIOS] for rows in (self.policy.parameters, drawn.nuisance, drawn.error)
        )
        count, n = len(actions), len(error)
        requests = Requests(
            parameters=np.tile(parameters, (count, 1)),
            context=np.tile(context, (count * n, 1)),
            action=(actions[:, None] + error).reshape(count * n, -1),
            nuisance=np.tile(nuisance, (count, 1)),
        )
        return self.roll(requests).rewards(task, requests.context).reshape(count, n)


@dataclass(frozen=True, eq=False)
class ConfirmingPolicies:
    """`Policies`: those of an emulator, which confirm their winners by true rollouts (`roll`)."""

    emulator: Emulator
    roll: Roll

    @property
    def task(self) -> Task:
        """The emulator's."""
        return self.emulator.task

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[ConfirmedPolicy, ...]:
        """See `sim.tasks.solver.PoliciesOf`."""
        trained = train_many(self.task, self.emulator, samples, rng, executable, settings)
        return tuple(ConfirmedPolicy(policy, self.roll) for policy in trained)
