"""The verdict on a session, in one or two sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.adaptation.method import Best, Iteration
from sim.adaptation.outlook import WORTHWHILE, Outlook
from sim.solvers.misfit import misfit
from sim.solvers.solver import Expectations
from sim.tasks.task import Task

LEAST_TRIALS = 6
"""With fewer trials the verdict is only that there are too few."""

SLACK = 1.5
"""Allowed misfit of a real trajectory, as a multiple of that of simulated ones: real motions and cameras add errors."""


def verdict(
    task: Task, history: Sequence[Iteration], expectations: Expectations, best: Best, ahead: Outlook | None = None
) -> str:
    """Whether to stop or to go on, and whether the simulator can express the object at all.

    `best` are the final parameters; `ahead` is the outlook, or None if the method makes no forecast.
    """
    trials = [trial for iteration in history for seen in iteration for trial in seen.trials]
    if ahead is None and len(trials) < LEAST_TRIALS:
        return f"Too few trials to judge: {len(trials)} so far, at least {LEAST_TRIALS} are needed."
    interval = f"{best.mean_reward:.2f}, 95 % interval {best.ci95[0]:.2f} to {best.ci95[1]:.2f}"
    limit = SLACK * expectations.misfit_limit
    strange = sum(misfit(expectations, t.context, t.action, t.observation) > limit for t in trials)
    unlike = (
        f"the simulator cannot express this {task.object_name}: {strange} of {len(trials)} trajectories lie "
        f"outside of what any parameters in the ranges predict"
        if 2 * strange > len(trials)
        else ""
    )
    if ahead is not None:
        return _advice(task, ahead, interval) + (f" {unlike[0].upper()}{unlike[1:]}." if unlike else "")
    return _by_parameters(task, history, best, interval, unlike)


def _advice(task: Task, ahead: Outlook, interval: str) -> str:
    """The verdict for a method with an outlook."""
    if ahead.hopeless:
        return (
            f"Stop here: no action in the ranges seems to suit this {task.object_name} (reward {interval}). Check how "
            "the tool is mounted, the object, and the calibration of the camera."
        )
    if ahead.done:
        return f"Stop here: reward {interval}; another iteration is worth {ahead.gain:.2f}."
    return (
        f"Go on: reward {interval}; another iteration is worth {ahead.gain:.2f}, and with a chance of "
        f"{100.0 * ahead.likely:.0f} % there is more than {WORTHWHILE:.2f} to gain."
    )


def _by_parameters(task: Task, history: Sequence[Iteration], best: Best, interval: str, unlike: str) -> str:
    """The verdict for a method that only moves parameters."""
    low = best.mean_reward < task.adaptation.threshold
    if unlike and low:
        return f"Reward stays low ({interval}), and {unlike}."
    if unlike:
        return f"The reward is good all the same ({interval}), but {unlike}."
    if low and len(history) >= 3 and not _improving(history):
        return (
            f"Reward stays low ({interval}) although the trajectories look like simulated ones: "
            f"no parameters in the ranges seem to give an action that suits this {task.object_name}."
        )
    doing_well = _iteration_rewards(history)[-1] >= task.adaptation.threshold
    if len(history) >= 2 and _settled(task, history) and doing_well and not low:
        return f"Converged: the parameters have stopped moving and the expected reward is {interval}."
    return f"Not converged yet: the best expected reward so far is {interval}."


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
