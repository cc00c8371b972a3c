"""The best particle of a session, and the verdict on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from sim.adaptation.method import (
    Best,
    Choosing,
    Forecasting,
    Iteration,
    Method,
    OwnPolicies,
    SessionForecast,
    Trial,
    trials_in,
)
from sim.adaptation.predictions import PredictionQuality, prediction_quality
from sim.adaptation.verdict import LEAST_TRIALS, Kind, Reason, Verdict
from sim.solvers.misfit import misfit
from sim.solvers.solver import policy_for
from sim.tasks.task import Executable, Expectations, Policies, SolvedPolicy, Task

PRIOR_MEAN, PRIOR_STD = 0.5, 0.3
"""Prior standard deviation of the session's general level of reward."""

SIGNAL_STD = 0.2
"""Standard deviation of the expected reward over the parameters."""

LENGTH = 0.3
"""Distance over which the expected reward varies, in fractions of the ranges and over all parameters: two steps of
0.15."""


def choose_best(task: Task, history: Sequence[Iteration]) -> Best:
    """The tried particle with the highest pooled estimate; the latest of equal ones.

    `ci95` is the 95 % interval of the expected reward; `trials` counts those within one LENGTH, which carry the
    estimate. Raises ValueError if the history has no trial.
    """
    candidates = [tried for iteration in history for tried in iteration if tried.trials]
    if not candidates:
        raise ValueError("no trial has been run yet, so there is no best")
    counts = np.array([len(s.trials) for s in candidates], dtype=np.float64)
    rewards = np.array([np.mean([t.reward for t in s.trials]) for s in candidates])
    unit = task.parameters.normalise(np.array([s.particle.mean for s in candidates]))
    mean, std = _posterior(unit, rewards, task.adaptation.trial_std**2 / counts)
    best = int(np.flatnonzero(mean >= mean.max() - 1e-9)[-1])
    near = np.linalg.norm(unit - unit[best], axis=1) <= LENGTH
    estimate = float(np.clip(mean[best], 0.0, 1.0))
    half = 1.96 * float(std[best])
    return Best(
        particle=candidates[best].particle,
        mean_reward=estimate,
        ci95=(max(0.0, estimate - half), min(1.0, estimate + half)),
        trials=int(counts[near].sum()),
    )


def best_of(method: Method, task: Task, history: Sequence[Iteration]) -> Best:
    """The final parameters: the method's own choice, else `choose_best`. Raises ValueError without a trial."""
    return method.choose(history) if isinstance(method, Choosing) else choose_best(task, history)


def final_policy(
    method: Method, policies: Policies, task: Task, history: Sequence[Iteration], executable: Executable | None = None
) -> SolvedPolicy:
    """The final task policy of a session. Raises ValueError if the history has no trial."""
    if isinstance(method, OwnPolicies):
        return method.final(history, executable)
    return policy_for(policies, best_of(method, task, history).particle.samples, executable)


SAME_ACTION = 0.02
"""Actions that differ by no more than this fraction of the range in any quantity count as the same."""


def repeated_trials(policy: SolvedPolicy, task: Task, history: Sequence[Iteration]) -> tuple[int, ...]:
    """The trials, numbered from 1 in the order of the history, whose action `policy` would repeat in their context."""
    trials = trials_in(history)
    if not trials:
        return ()
    actions = policy.actions(np.array([trial.context for trial in trials]))
    commanded = np.array([trial.action for trial in trials])
    off = np.abs(task.action.normalise(actions) - task.action.normalise(commanded)).max(axis=1)
    return tuple(int(i) + 1 for i in np.flatnonzero(off <= SAME_ACTION))


def assess(method: Method, task: Task, history: Sequence[Iteration]) -> tuple[Best, SessionForecast | None]:
    """The final parameters, and the forecast of a method that forecasts. Raises ValueError if there is no trial."""
    return method.assess(history) if isinstance(method, Forecasting) else (best_of(method, task, history), None)


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


SLACK = 1.5
"""Allowed misfit of a real trajectory, as a multiple of that of simulated ones: real motions and cameras add errors."""


@dataclass(frozen=True, eq=False)
class Misfits:
    """The misfits of a session's trials, each computed once."""

    expectations: Expectations
    _misfits: dict[bytes, float] = field(default_factory=dict, repr=False)

    def of(self, trial: Trial) -> float:
        """The misfit of a trial (`sim.solvers.misfit`)."""
        if trial.key not in self._misfits:
            self._misfits[trial.key] = misfit(self.expectations, trial.context, trial.action, trial.observation)
        return self._misfits[trial.key]


def verdict_of(
    task: Task, history: Sequence[Iteration], misfits: Misfits, best: Best, forecast: SessionForecast | None = None
) -> Verdict:
    """Whether to stop or to go on, and whether the simulator can express the object at all.

    `best` are the final parameters; `forecast` is None if the method makes none.
    """
    trials = trials_in(history)
    limit = SLACK * misfits.expectations.misfit_limit
    strange = 0 if np.isinf(limit) else sum(misfits.of(t) > limit for t in trials)  # a misfit may cost rollouts
    reasons = [Reason.INEXPRESSIBLE] if 2 * strange > len(trials) else []
    if forecast is not None and forecast.has_only_failed:
        reasons.append(Reason.FAILURES)
    if forecast is not None and forecast.untried and not forecast.hopeless:
        reasons.append(Reason.UNTRIED)
    if forecast is None:
        kind, further = _by_parameters(task, history, best, bool(reasons))
        reasons += further
    else:
        kind = Kind.HOPELESS if forecast.hopeless else Kind.ENOUGH if forecast.done else Kind.GO_ON
    quality = None if forecast is None else _quality(history)
    if quality is not None and quality.is_uninformed and kind is not Kind.HOPELESS:
        kind = Kind.UNINFORMED
    return Verdict(
        kind=kind,
        reasons=tuple(reasons) if forecast is not None or len(trials) >= LEAST_TRIALS else (),
        reward=best.mean_reward,
        ci95=best.ci95,
        trials=len(trials),
        strange=strange,
        prediction_error=None if quality is None else quality.error,
        rank_correlation=None if quality is None else quality.rank_correlation,
    )


def _quality(history: Sequence[Iteration]) -> PredictionQuality | None:
    """The quality of the predictions from the second iteration on, which rest on at least one trial."""
    trials = trials_in(history[1:])
    latest = sum(len(entry.trials) for entry in history[-1])
    return prediction_quality(np.array([t.predicted for t in trials]), np.array([t.reward for t in trials]), latest)


FULL = 0.995
"""Larger rewards are shown as 1.00, the largest possible reward."""


def _by_parameters(
    task: Task, history: Sequence[Iteration], best: Best, is_inexpressible: bool
) -> tuple[Kind, list[Reason]]:
    """The kind of verdict for a method that only moves parameters, and why."""
    if sum(len(entry.trials) for iteration in history for entry in iteration) < LEAST_TRIALS:
        return Kind.TOO_FEW, []
    if best.mean_reward < task.adaptation.threshold:
        is_stuck = len(history) >= 3 and not _improving(history)
        return (Kind.STAYS_LOW if is_inexpressible or is_stuck else Kind.NOT_CONVERGED), []
    latest = trials_in(history[-1:])
    if latest and all(trial.reward >= FULL for trial in latest):
        return Kind.CONVERGED, [Reason.FULL]
    if _iteration_rewards(history)[-1] < task.adaptation.threshold:
        return Kind.NOT_CONVERGED, []
    if len(history) < 2:
        return Kind.NOT_CONVERGED, []
    return (Kind.CONVERGED, []) if _settled(task, history) else (Kind.NOT_CONVERGED, [Reason.MOVING])


def _iteration_rewards(history: Sequence[Iteration]) -> list[float]:
    pooled = [[t.reward for entry in iteration for t in entry.trials] for iteration in history]
    return [float(np.mean(rewards)) for rewards in pooled if rewards]


def _improving(history: Sequence[Iteration]) -> bool:
    """Whether the later half of the iterations earned clearly more than the earlier."""
    rewards = _iteration_rewards(history)
    half = len(rewards) // 2
    return float(np.mean(rewards[half:])) - float(np.mean(rewards[:half])) > 0.1


def _settled(task: Task, history: Sequence[Iteration]) -> bool:
    """Whether some particle moved by at most one step in one parameter in the last iteration."""
    before, after = history[-2], history[-1]
    moves = [
        np.abs(task.parameters.normalise(new.particle.mean) - task.parameters.normalise(old.particle.mean)).sum()
        for old, new in zip(before, after, strict=False)
    ]
    return bool(moves) and float(min(moves)) <= task.adaptation.delta + 1e-9
