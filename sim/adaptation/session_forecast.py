"""The reward that a session may expect of its final policy, and the size of its corrections, from draws of reality."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.method import FAILED, SessionForecast
from sim.adaptation.outcome_posterior import OutcomePosterior, predicted_interval
from sim.rollouts.draws import cover
from sim.tasks.task import SolvedPolicy

CONTEXTS = 16
"""Number of evenly spread contexts for all averages."""

CAUTION = 0.5
"""Caution of the first particle and of the final policy, in standard deviations."""


def session_forecast(posterior: OutcomePosterior, for_e: SolvedPolicy, *, untried: bool) -> SessionForecast:
    """The forecast by `posterior`; `for_e` is the simulator's policy for the parameters shown beside it.

    `untried`: see `SessionForecast`.
    """
    task = posterior.simulators.task
    n = CONTEXTS if len(task.context) else 1
    contexts = cover(task.context, n, np.random.default_rng(0))
    answers = [posterior.candidate_outcomes(context) for context in contexts]
    earned = np.stack([one.rewards(context) for one, context in zip(answers, contexts, strict=True)])  # (n, A, KEPT)
    chosen = _chosen(earned)
    now = earned[np.arange(n), chosen].mean(axis=0)
    mean = float(now.mean())
    off = np.stack([one.actions[i] for one, i in zip(answers, chosen, strict=True)]) - for_e.actions(contexts)
    return SessionForecast(
        reward=mean,
        ci95=predicted_interval(now),
        failures=_failures(posterior),
        untried=untried,
        correction=off.mean(axis=0),
        correction_std=off.std(axis=0),
    )


def _failures(posterior: OutcomePosterior) -> int:
    earned = [trial.reward > FAILED for trial in reversed(posterior.trials)]
    return earned.index(True) if True in earned else len(earned)


def _chosen(earned: Array) -> NDArray[np.intp]:
    """(n,) the best action for each context, by the rewards (n, A, KEPT)."""
    return np.asarray((earned.mean(axis=-1) - CAUTION * earned.std(axis=-1)).argmax(axis=1))
