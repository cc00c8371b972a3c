"""Meta-episodes: trials and rewards of parameter distributions in simulated targets, many at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from hw.types import Array
from sim.adaptation.memory import MemoryName, Seen, encode, look_back
from sim.adaptation.method import Trial
from sim.pretraining.q_training import Transitions
from sim.rollouts.draws import trial_requests
from sim.rollouts.run import Roll
from sim.solvers.solver import Solver, SolverSettings
from sim.tasks.task import Task


@dataclass(frozen=True)
class EpisodeSettings:
    """The resolution of a step of an episode."""

    solver: SolverSettings = field(default_factory=lambda: SolverSettings(scenarios=8))
    contexts: int = 8  # for the average of a reward
    draws: int = 8  # of action error and nuisance, for the same average


@dataclass(frozen=True, eq=False)
class Visit:
    """Observations and rewards of B distributions in their targets."""

    observations: Array  # (B, T * size) with camera noise: true rollouts of the target
    trial_rewards: Array  # (B, T) of those rollouts
    rewards: Array  # (B,) expected by the solver


def visit(
    solver: Solver,
    roll: Roll,
    means: Array,
    targets: Array,
    rng: np.random.Generator,
    settings: EpisodeSettings,
) -> Visit:
    """Train the task policies of `means` (B, p), run each `trials_per_iteration` times in its target (B, p).

    The trajectories are true rollouts. The reward is the solver's expectation over contexts, nuisance and action error,
    which would need hundreds of rollouts; the evaluation compares it with true rollouts.
    """
    task = solver.task
    policies = solver.policies(means[:, None, :], rng, settings=settings.solver)
    trials, count = task.adaptation.trials_per_iteration, len(means)
    own = task.context.sample(rng, count * trials).reshape(count, trials, -1)
    shared = task.context.sample(rng, settings.contexts)
    actions = np.stack([p.actions(np.concatenate([c, shared])) for p, c in zip(policies, own, strict=True)])
    requests = trial_requests(
        task, np.repeat(targets, trials, axis=0), own.reshape(count * trials, -1), _rows(actions[:, :trials]), rng
    )
    rollouts = roll(requests)
    seen = task.observation.with_noise(rollouts.observation, rng)
    earned = rollouts.rewards(task, requests.context)
    rewards = solver.expected_rewards(targets, shared, actions[:, trials:], rng, settings.draws)
    return Visit(seen.reshape(count, -1), earned.reshape(count, -1), rewards)


@dataclass(frozen=True, eq=False)
class Episodes:
    """E episodes: P particles adapt to the same target over H steps, so each is visited H + 1 times."""

    targets: Array  # (E, p) in units
    means: Array  # (E, P, H + 1, p) in units
    observations: Array  # (E, P, H + 1, T * size) normalised, with camera noise
    trial_rewards: Array  # (E, P, H + 1, T)
    rewards: Array  # (E, P, H + 1) expected
    directions: Array  # (E, P, H, p) in {-1, 0, 1}

    def transitions(self, task: Task, memory: MemoryName, threshold: float | None = None) -> Transitions:
        """Every step of every particle, in the view of a policy with this memory, with the sparse reward."""
        horizon = self.directions.shape[2]
        states = [encode(task, memory, self._seen(t)) for t in range(horizon + 1)]

        def flat(values: Array) -> Array:
            """(E, P, H, ...) -> (H * E * P, ...), in the order of the states."""
            return np.moveaxis(values, 2, 0).reshape(-1, *values.shape[3:])

        return Transitions(
            state=np.concatenate(states[:-1]),
            directions=flat(self.directions).astype(np.int_),
            reward=sparse(task, flat(self.rewards[:, :, 1:]), threshold),
            next_state=np.concatenate(states[1:]),
        )

    def _seen(self, t: int) -> Seen:
        until = slice(0, t + 1)
        return look_back(self.means[:, :, until], self.observations[:, :, until], self.trial_rewards[:, :, until])


def join_episodes(parts: Sequence[Episodes]) -> Episodes:
    """All episodes as one, in the order of the parts."""
    return Episodes(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Episodes)))


def sparse(task: Task, rewards: Array, threshold: float | None = None) -> Array:
    """The rewards that reach the threshold (default: the task's); all others become 0 (paper, eq. A1)."""
    return np.where(rewards >= (task.adaptation.threshold if threshold is None else threshold), rewards, 0.0)


def simulated_trials(
    task: Task, policy: Callable[[Array], Array], target: Array, roll: Roll, n: int, rng: np.random.Generator
) -> tuple[Trial, ...]:
    """`n` trials of a policy in a simulated target (p,), in a session's form."""
    contexts = task.context.sample(rng, n)
    actions = np.stack([policy(c) for c in contexts])
    results = roll(trial_requests(task, np.tile(target, (n, 1)), contexts, actions, rng))
    seen = task.observation.with_noise(results.observation, rng)
    rewards = results.rewards(task, contexts)
    ends = results.ends()
    rows = zip(contexts, actions, seen, rewards, ends, strict=True)
    return tuple(Trial(c, a, o, float(r), end) for c, a, o, r, end in rows)


def _rows(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])
