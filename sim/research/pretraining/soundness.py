"""The first rollouts of a task, checked before a quarter of an hour is spent on more of them."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import RolloutError
from sim.tasks.task import Task

_FIRST = 8


def require_sound(task: Task, rng: np.random.Generator) -> None:
    """Simulate a few rollouts all over the ranges, and the first one twice.

    Raises RolloutError naming the task and the value if one raises or returns no track, if a reward is not a number
    from 0 to 1, if an observation is not finite, or if the same rollout gives another trajectory.
    """
    spaces = (task.margin, task.context, task.action, task.nuisance)
    drawn = [tuple(space.sample(rng, 1)[0] for space in spaces) for _ in range(_FIRST)]
    tracks = [_simulated(task, *values) for values in drawn]
    for values, track in zip(drawn, tracks, strict=True):
        _require_numbers(task, track, values[1])
    again = _simulated(task, *drawn[0])
    first = tracks[0]
    same = first.outcome is again.outcome and np.array_equal(first.state, again.state)
    if not (same and np.array_equal(first.t_s, again.t_s)):
        off = np.abs(first.state - again.state).max() if first.state.shape == again.state.shape else float("nan")
        raise RolloutError(
            f"the task {task.name} is not deterministic: the same rollout differs by up to {off:.3g} the second time. "
            "`simulate` may use no random numbers but its arguments: seed them there, or take them from the nuisance"
        )


def _simulated(task: Task, parameters: Array, context: Array, action: Array, nuisance: Array) -> ObjectTrack:
    try:
        if task.simulate_many is not None:
            track = task.simulate_many(parameters[None], context[None], action[None], nuisance[None])[0]
        else:
            track = task.simulate(parameters, context, action, nuisance)
    except Exception as error:  # a task of another package may raise anything
        raise RolloutError(
            f"the task {task.name} cannot simulate parameters {parameters.tolist()}, action {action.tolist()}: "
            f"{type(error).__name__}: {error}"
        ) from error
    if not isinstance(track, ObjectTrack):
        raise RolloutError(f"`simulate` of the task {task.name} returns {type(track).__name__}, not an ObjectTrack")
    return track


def _require_numbers(task: Task, track: ObjectTrack, context: Array) -> None:
    try:
        reward, observation = float(task.score(track, context)), np.asarray(task.observation(track))
    except Exception as error:
        raise RolloutError(f"the task {task.name} cannot score its rollout: {type(error).__name__}: {error}") from error
    if not (np.isfinite(reward) and 0.0 <= reward <= 1.0):
        raise RolloutError(
            f"the task {task.name} gives the reward {reward:g} for a rollout that ends {track.outcome.value}: rewards "
            "are numbers from 0 to 1 (`reward_of_success`)"
        )
    if not np.isfinite(observation).all():
        raise RolloutError(f"the task {task.name} has observations that are not finite: check the states of its track")
