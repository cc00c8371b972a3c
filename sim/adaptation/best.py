"""Chooses the final parameters of a session among the tried ones.

The best average of two noisy trials is often the wrong choice. Trials at neighbouring parameters inform each other, so
they are pooled by a Gaussian process with fixed hyperparameters over the normalised means.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.types import Array
from sim.adaptation.method import Best, Forecasting, Iteration, Method, Outlook, OwnPolicies
from sim.solvers.solver import Executable, Policies, SolvedPolicy, policy_for
from sim.tasks.task import Task

PRIOR_MEAN, PRIOR_STD = 0.5, 0.3
"""Prior standard deviation of the session's general level of reward."""

SIGNAL_STD = 0.2
"""Standard deviation of the expected reward over the parameters."""

LENGTH = 0.3
"""Distance over which it varies, in fractions of the ranges and over all parameters together: two steps of 0.15."""


def choose_best(task: Task, history: Sequence[Iteration]) -> Best:
    """The tried particle with the highest pooled estimate; the latest of equal ones.

    `ci95` is the 95 % interval of the expected reward; `trials` counts those within one LENGTH, which carry the
    estimate. Raises ValueError if the history has no trial.
    """
    seen = [tried for iteration in history for tried in iteration if tried.trials]
    if not seen:
        raise ValueError("no trial has been run yet, so there is no best")
    counts = np.array([len(s.trials) for s in seen], dtype=np.float64)
    rewards = np.array([np.mean([t.reward for t in s.trials]) for s in seen])
    unit = task.parameters.normalise(np.array([s.particle.mean for s in seen]))
    mean, std = _posterior(unit, rewards, task.adaptation.trial_std**2 / counts)
    best = int(np.flatnonzero(mean >= mean.max() - 1e-9)[-1])
    near = np.linalg.norm(unit - unit[best], axis=1) <= LENGTH
    estimate = float(np.clip(mean[best], 0.0, 1.0))
    half = 1.96 * float(std[best])
    return Best(
        particle=seen[best].particle,
        mean_reward=estimate,
        ci95=(max(0.0, estimate - half), min(1.0, estimate + half)),
        trials=int(counts[near].sum()),
    )


def final_policy(
    method: Method, policies: Policies, task: Task, history: Sequence[Iteration], executable: Executable | None = None
) -> SolvedPolicy:
    """The final task policy of a session. Raises ValueError if the history has no trial."""
    if isinstance(method, OwnPolicies):
        return method.final(history, executable)
    return policy_for(policies, choose_best(task, history).particle.samples, executable)


def assess(method: Method, task: Task, history: Sequence[Iteration]) -> tuple[Best, Outlook | None]:
    """The final parameters, and the outlook of a method that forecasts. Raises ValueError if there is no trial."""
    return method.assess(history) if isinstance(method, Forecasting) else (choose_best(task, history), None)


def _posterior(unit: Array, rewards: Array, variance: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of the expected reward at every tried mean, from mean rewards of that variance.

    Rasmussen & Williams 2006, eq. 2.25.
    """
    squared = ((unit[:, None] - unit[None]) ** 2).sum(axis=-1)
    prior = PRIOR_STD**2 + SIGNAL_STD**2 * np.exp(-0.5 * squared / LENGTH**2)
    gain = np.linalg.solve(prior + np.diag(variance), prior).T
    mean = PRIOR_MEAN + gain @ (rewards - PRIOR_MEAN)
    left = np.diag(prior - gain @ prior)
    return mean, np.sqrt(np.maximum(left, 0.0))
