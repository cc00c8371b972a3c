"""Checks whether the rewards of a task are numbers from 0 to 1, take stacks of trials, and differ between actions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from hw.types import Array
from sim.errors import SimError
from sim.rollouts.sampled_rollouts import SampledRollout, TaskFinding, described
from sim.tasks.task import Task

_ENDS = 512
"""Ends of trials at which a reward is tried."""

_CONTEXTS = 16
"""Contexts at which the reward of an end is compared."""


def _unclipped(task: Task, end: Array, context: Array) -> Array:
    """The reward as the user's function returns it: a task of a file counts less than 0 as 0."""
    function = getattr(task.reward_of_success, "function", task.reward_of_success)
    raw = getattr(function, "unclipped", None)
    return np.asarray(task.reward_of_success(end, context)) if raw is None else np.maximum(raw(end, context), 0.0)


def reward_complaints(task: Task, rolls: Sequence[SampledRollout]) -> Iterator[str]:
    """Sentences about rewards that are not numbers from 0 to 1, or that differ in a stack of trials."""
    where = "reward" if task.file else "reward_of_success"
    right = f"rewards are numbers from 0 to 1 (`{where}`)"
    for one in rolls:
        try:
            end = task.end_of(one.track)
            if end is None:
                yield from _failure(task, one, right)
                continue
            end = np.atleast_1d(end)
            reward = np.asarray(_unclipped(task, end, one.context))
            if reward.size != 1:
                yield f"the reward of one trial of {task.name} has the shape {reward.shape}: it must be one number"
                return
            value = float(reward.reshape(-1)[0])
            again = float(np.asarray(_unclipped(task, end, one.context)).reshape(-1)[0])
            if not np.array_equal(value, again, equal_nan=True):
                yield (
                    f"the reward of {task.name} is {value:.4g}, and the second time {again:.4g} for the same end and "
                    "context: it may use nothing else, and no random numbers"
                )
                return
        except SimError:
            raise
        except Exception as error:  # noqa: BLE001 - a task of another package may raise anything
            yield f"the task {task.name} cannot score its rollout: {type(error).__name__}: {error}"
            return
        if not (np.isfinite(value) and 0.0 <= value <= 1.0 + 1e-9):
            yield f"the task {task.name} gives the reward {value:g} with {described(task, one)}: {right}"
        yield from _stacks(task, end, one.context, value)


def _failure(task: Task, one: SampledRollout, right: str) -> Iterator[str]:
    value = task.failure_reward(one.track)
    if not (np.isfinite(value) and 0.0 <= value <= 1.0):
        yield f"the task {task.name} gives a failure the reward {value:g} with {described(task, one)}: {right}"


def _stacks(task: Task, end: Array, context: Array, value: float) -> Iterator[str]:
    try:
        stacked = np.asarray(task.reward_of_success(np.tile(end, (3, 2, 1)), np.tile(context, (2, 1))))
    except Exception as error:  # noqa: BLE001 - a task of another package may raise anything
        yield (
            f"`reward_of_success` of {task.name} takes no stack of trials ({type(error).__name__}: {error}): ends "
            "(..., k) and contexts (..., c) must give rewards (...)"
        )
        return
    if stacked.shape != (3, 2) or not np.allclose(stacked, np.clip(value, 0.0, 1.0)):
        yield (
            f"`reward_of_success` of {task.name} gives the shape {stacked.shape} for ends of shape "
            f"{(3, 2, len(end))}: it must give {(3, 2)}"
        )


def reward_knows(task: Task, ends: Array, rng: np.random.Generator) -> bool:
    """Whether the context changes the reward of any of the ends (N, k)."""
    contexts = task.context.sample(rng, _CONTEXTS)
    rewards = np.stack([task.reward_of_success(ends, np.tile(context, (len(ends), 1))) for context in contexts])
    return bool((np.ptp(rewards, axis=0) > 0.0).any())


def reward_tells(task: Task, rolls: Sequence[SampledRollout], rng: np.random.Generator) -> Iterator[TaskFinding]:
    """Whether the reward depends on the end of a trial."""
    check = "the reward tells trials apart"
    scored = [(one, np.atleast_1d(end)) for one in rolls if (end := task.end_of(one.track)) is not None]
    if not scored:
        yield TaskFinding(check, "doubtful", f"none of {len(rolls)} rollouts is a success, so no reward was seen")
        return
    rows = np.stack([end for _, end in scored])
    width = np.maximum(np.ptp(rows, axis=0), 1e-9)
    tried = np.concatenate([rows, rows.min(0) - width + 3.0 * width * rng.random((_ENDS, rows.shape[1]))])
    contexts = task.context.sample(rng, len(tried))
    rewards = np.asarray(task.reward_of_success(tried, contexts))
    if np.ptp(rewards) == 0.0:
        yield TaskFinding(
            check,
            "broken",
            f"the reward of {task.name} is {rewards[0]:g} for each of {len(tried)} ends and contexts: it must depend "
            "on the end of a trial",
        )
        return
    fixed = np.asarray(task.reward_of_success(tried, np.broadcast_to(contexts[0], contexts.shape)))
    if all(np.ptp(task.reward_of_success(tried, np.broadcast_to(c, contexts.shape))) == 0.0 for c in contexts[:16]):
        yield TaskFinding(
            check,
            "broken",
            f"the reward of {task.name} ignores the end of a trial: at one context it is always {fixed[0]:g}",
        )
        return
    earned = np.array([float(task.reward_of_success(end, one.context)) for one, end in scored])
    if np.ptp(earned) == 0.0:
        summary = f"each of {len(scored)} rollouts earns {earned[0]:g}: is any action worth more?"
        yield TaskFinding(check, "doubtful", summary)
        return
    summary = f"{len(scored)} rollouts earn {earned.mean():.2f} on average, and at most {earned.max():.2f}"
    yield TaskFinding(check, "kept", summary)
