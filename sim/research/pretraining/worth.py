"""The worth of a pretraining in the unit of the reward, for its card and for the screen before a first trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.reward_table import RewardTable
from sim.adaptation.simulators import Simulators
from sim.research.identifiability import PARTLY, errors_left
from sim.rollouts.draws import cover
from sim.tasks.task import Solver

HALF = 0.5
"""The expected reward below which a place counts as hopeless."""

TRUTHS, CONTEXTS = 64, 16
"""Number of parameter vectors in the ranges, and of contexts for each, at which the best actions are examined."""

END = 0.02
"""An action counts as lying at the end of its range if it is within this share of the range from the end."""


@dataclass(frozen=True)
class Worth:
    """The gain that a session may expect from a checkpoint."""

    reward_error: float | None  # mean error of an expected reward on unseen rollouts; None: true rollouts answer
    hopeless_parameters: float  # share of Omega where no action is expected to earn half, averaged over contexts
    hopeless_contexts: float  # share of contexts in which no action is expected to earn half, averaged over Omega
    unknown_parameters: tuple[str, ...]  # that no session tells apart from the others
    actions_at_end: dict[str, float]  # share of the best actions at an end of their range, by name


def measured_worth(solver: Solver, reward_table: RewardTable, reward_error: float | None, seed: int) -> Worth:
    """Look at the best actions for parameters all over Omega, and at imagined sessions."""
    task = solver.task
    truths = cover(task.parameters, TRUTHS, np.random.default_rng(seed))
    contexts = cover(task.context, CONTEXTS if len(task.context) else 1, np.random.default_rng(seed))
    policies = solver.policies(truths[:, None], np.random.default_rng(seed))
    actions = np.stack([policy.actions(contexts) for policy in policies])  # (T, G, a)
    earned = _earned(solver, truths, contexts, actions)
    left = errors_left(Simulators(solver, reward_table), seed)
    unit = task.action.normalise(actions)
    at_end = ((unit < END) | (unit > 1.0 - END)).mean(axis=(0, 1))
    return Worth(
        reward_error=None if reward_error is None else round(reward_error, 4),
        hopeless_parameters=float((earned.mean(axis=1) < HALF).mean()),
        hopeless_contexts=float((earned < HALF).mean()),
        unknown_parameters=tuple(
            name for name, one in zip(task.parameters.names, left, strict=True) if not one < PARTLY
        ),
        actions_at_end={name: round(float(v), 3) for name, v in zip(task.action.names, at_end, strict=True)},
    )


def _earned(solver: Solver, truths: Array, contexts: Array, actions: Array) -> Array:
    """(T, G) expected rewards of each truth's own actions in each context."""
    task, (t, g) = solver.task, actions.shape[:2]
    middle = np.tile(task.nuisance.middle, (t * g, 1))
    earned = solver.trial_rewards(
        np.repeat(truths, g, axis=0), np.tile(contexts, (t, 1)), actions.reshape(t * g, -1), middle
    )
    return np.asarray(earned.reshape(t, g))
