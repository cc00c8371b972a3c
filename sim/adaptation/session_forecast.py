"""The gain that a session may still expect, and the size of its corrections, from the draws of reality.

What would another iteration change? One draw at a time is taken for the truth. Its outcomes of the next trials weigh
the other draws, these choose new actions, and the true draw says what they earn (value of sample information, Howard
1966). A draw never helps to choose the actions that are judged by it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.discrepancy import LEAST_END_STD
from sim.adaptation.method import FAILED, WORTHWHILE, SessionForecast
from sim.adaptation.outcome_posterior import KEPT, OutcomePosterior, predicted_interval
from sim.rollouts.draws import cover
from sim.solvers.candidates import Outcomes
from sim.solvers.solver import SolvedPolicy

CONTEXTS = 16
"""Number of evenly spread contexts for all averages."""

CAUTION = 0.5
"""Caution of the first particle and of the final policy, in standard deviations."""

_EFFECTIVE = 12.0
"""Least effective number of draws behind a choice: fewer would choose by their own errors."""
_EASED = 0.8 ** np.arange(40)
_SURE = 0.05
"""No draw is surer of success or failure than this."""
_UNLIKE = 8.0
"""The most that one end state can speak against a draw, in log-likelihood."""
_OTHER_STD = 0.05
"""The difference that reality adds to an end state, in the unit of end states."""


def session_forecast(
    posterior: OutcomePosterior, for_e: SolvedPolicy, optimism: Array, *, untried: bool
) -> SessionForecast:
    """The forecast by `posterior`; `for_e` is the simulator's policy for the parameters shown beside it.

    `optimism` (n,) are the standard deviations that the particles of the next iteration add to the expected reward.
    `untried`: see `SessionForecast`.
    """
    task = posterior.simulators.task
    n = CONTEXTS if len(task.context) else 1
    contexts = cover(task.context, n, np.random.default_rng(0))
    answers = [posterior.candidate_outcomes(context) for context in contexts]
    earned = np.stack([one.rewards(context) for one, context in zip(answers, contexts, strict=True)])  # (n, A, KEPT)
    chosen = _chosen(earned, np.full((KEPT, KEPT), 1.0 / KEPT))[:, 0]
    now = earned[np.arange(n), chosen].mean(axis=0)
    mean = float(now.mean())
    low, high = predicted_interval(now)
    where, tried = _next_trials(earned, optimism, task.adaptation.trials_per_iteration)
    weights = _weights([answers[i] for i in where], tried, posterior.simulators.end_unit)
    gains = _gains(earned, weights)
    off = np.stack([one.actions[i] for one, i in zip(answers, chosen, strict=True)]) - for_e.actions(contexts)
    return SessionForecast(
        reward=mean,
        ci95=(low, high),
        gain=max(0.0, float(gains.mean())),
        likely=float((gains > WORTHWHILE).mean()),
        failures=_failures(posterior),
        untried=untried,
        correction=off.mean(axis=0),
        correction_std=off.std(axis=0),
    )


def _failures(posterior: OutcomePosterior) -> int:
    earned = [trial.reward > FAILED for trial in reversed(posterior.trials)]
    return earned.index(True) if True in earned else len(earned)


def _next_trials(earned: Array, optimism: Array, each: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(m,) contexts and (m,) actions of the next iteration, `each` per particle, in evenly spread contexts."""
    where = np.unique(np.linspace(0, len(earned) - 1, each).astype(int))
    mean, std = earned[where].mean(axis=-1), earned[where].std(axis=-1)
    tried = np.concatenate([(mean + more * std).argmax(axis=1) for more in optimism])
    return np.tile(where, len(optimism)), tried


def _gains(earned: Array, weights: Array) -> Array:
    """(KEPT,) the gain if this draw is the truth and the trials leave `weights` (KEPT, KEPT); `earned` (n, A, KEPT)."""
    others = (1.0 - np.eye(KEPT)) / (KEPT - 1)
    contexts, truth = np.arange(len(earned))[:, None], np.arange(KEPT)
    before = earned[contexts, _chosen(earned, others), truth].mean(axis=0)
    after = earned[contexts, _chosen(earned, weights), truth].mean(axis=0)
    return np.asarray(after - before)


def _chosen(earned: Array, weights: Array) -> NDArray[np.intp]:
    """(n, K) the best actions for each context by each row of `weights` (K, KEPT) over the draws."""
    mean = earned @ weights.T
    std = np.sqrt(np.maximum(earned**2 @ weights.T - mean**2, 0.0))
    return np.asarray((mean - CAUTION * std).argmax(axis=1))


def _weights(answers: Sequence[Outcomes], tried: NDArray[np.intp], unit: Array) -> Array:
    """(KEPT, KEPT) the weights of all other draws after the trials of the actions `tried`, each with the `answers` of
    its context; one row for each draw as the truth.
    """
    trials = list(zip(answers, tried, strict=True))
    success = np.stack([one.success[i] for one, i in trials]).mean(axis=-1)
    ends = np.stack([one.end_state[i] for one, i in trials]) / unit
    end, spread = ends.mean(axis=2), ends.var(axis=2).mean(axis=1, keepdims=True)
    by_success = _cross_entropy(success)
    apart = (end[:, :, None] - end[:, None]) ** 2 / (2.0 * (spread + LEAST_END_STD**2 + _OTHER_STD**2))[:, :, None]
    log = (by_success - success[:, :, None] * np.minimum(apart.sum(axis=-1), _UNLIKE)).sum(axis=0)
    np.fill_diagonal(log, -np.inf)
    return np.stack([_eased(row - row.max()) for row in log])


def _cross_entropy(success: Array) -> Array:
    """(m, K) chances -> (m, K, K) expected log-likelihood of the second draw if the first is the truth."""
    chance, other = success[:, :, None], np.clip(success, _SURE, 1.0 - _SURE)[:, None]
    return np.asarray(chance * np.log(other) + (1.0 - chance) * np.log(1.0 - other))


def _eased(log: Array) -> Array:
    """(K,) weights with at least `_EFFECTIVE` effective draws."""
    for power in _EASED:
        weights = np.exp(power * log)
        weights /= weights.sum()
        if (weights**2).sum() * _EFFECTIVE <= 1.0:
            break
    return np.asarray(weights)
