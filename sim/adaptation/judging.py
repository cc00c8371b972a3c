"""Judges a session by its trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.adaptation.method import Best, Iteration, Outlook
from sim.adaptation.verdict import LEAST_TRIALS, Kind, Reason, Verdict
from sim.solvers.misfit import misfit
from sim.solvers.solver import Expectations
from sim.tasks.task import Task

SLACK = 1.5
"""Allowed misfit of a real trajectory, as a multiple of that of simulated ones: real motions and cameras add errors."""


def judge(
    task: Task, history: Sequence[Iteration], expectations: Expectations, best: Best, ahead: Outlook | None = None
) -> Verdict:
    """Whether to stop or to go on, and whether the simulator can express the object at all.

    `best` are the final parameters; `ahead` is the outlook, or None if the method makes no forecast.
    """
    trials = [trial for iteration in history for seen in iteration for trial in seen.trials]
    limit = SLACK * expectations.misfit_limit
    strange = sum(misfit(expectations, t.context, t.action, t.observation) > limit for t in trials)
    found = [Reason.INEXPRESSIBLE] if 2 * strange > len(trials) else []
    if ahead is not None and ahead.has_only_failed:
        found.append(Reason.FAILURES)
    return Verdict(
        kind=_by_parameters(task, history, best, bool(found)) if ahead is None else _by_forecast(ahead),
        reasons=tuple(found) if ahead is not None or len(trials) >= LEAST_TRIALS else (),
        reward=best.mean_reward,
        ci95=best.ci95,
        trials=len(trials),
        strange=strange,
        gain=None if ahead is None else ahead.gain,
        likely=None if ahead is None else ahead.likely,
    )


def _by_forecast(ahead: Outlook) -> Kind:
    """The kind of verdict for a method with an outlook."""
    return Kind.HOPELESS if ahead.hopeless else Kind.ENOUGH if ahead.done else Kind.GO_ON


def _by_parameters(task: Task, history: Sequence[Iteration], best: Best, is_inexpressible: bool) -> Kind:
    """The kind of verdict for a method that only moves parameters."""
    if sum(len(seen.trials) for iteration in history for seen in iteration) < LEAST_TRIALS:
        return Kind.TOO_FEW
    if best.mean_reward < task.adaptation.threshold:
        is_stuck = len(history) >= 3 and not _improving(history)
        return Kind.STAYS_LOW if is_inexpressible or is_stuck else Kind.NOT_CONVERGED
    doing_well = _iteration_rewards(history)[-1] >= task.adaptation.threshold
    is_settled = len(history) >= 2 and _settled(task, history)
    return Kind.CONVERGED if is_settled and doing_well else Kind.NOT_CONVERGED


def _iteration_rewards(history: Sequence[Iteration]) -> list[float]:
    pooled = [[t.reward for seen in iteration for t in seen.trials] for iteration in history]
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
