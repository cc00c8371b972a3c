"""The first rollouts of a task, checked before a quarter of an hour is spent on more of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import RolloutError
from sim.tasks.task import Task

_FIRST = 8

_MOVED, _MOVED_ROLLOUTS = 2e-3, 2
"""`relocate` is false if so many rollouts differ from the relocated ones by more than the first, in fractions of the
observation's bounds, and by more than contact makes of a rounding error (`_NUDGE`).
"""

_NUDGE, _CHAOS = 1e-4, 10.0
"""A rollout whose action is changed by this fraction shows how sensitive it is; a difference of so many times as much
is none of `relocate`.
"""


def require_sound(task: Task, rng: np.random.Generator) -> None:
    """Simulate a few rollouts all over the ranges, and the first one twice.

    Raises RolloutError naming the task and the value if one raises or returns no track, if a reward is not a number
    from 0 to 1, if an observation is not finite, if the same rollout gives another trajectory, or if a context moves
    the object otherwise than `Task.relocate` says.
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
    _require_relocated(task, drawn, tracks)


def _require_relocated(
    task: Task, drawn: Sequence[tuple[Array, Array, Array, Array]], tracks: Sequence[ObjectTrack]
) -> None:
    """Compare the rollouts in drawn contexts with those that `relocate` makes of rollouts at the reference context."""
    if task.relocate is None or not len(task.context):
        return
    reference = np.asarray(task.reference_context, dtype=np.float64)
    worst, different = (0.0, reference), 0
    for (parameters, context, action, nuisance), track in zip(drawn, tracks, strict=True):
        at_reference = task.observation(_simulated(task, parameters, reference, action, nuisance))
        off = float(np.abs(task.observation(track) - task.at_context(at_reference, context)).max())
        if off > _MOVED:
            nudged = task.observation(_simulated(task, parameters, reference, action * (1.0 + _NUDGE), nuisance))
            if off > _CHAOS * float(np.abs(nudged - at_reference).max()):
                different, worst = different + 1, max(worst, (off, context), key=lambda pair: pair[0])
    if different >= _MOVED_ROLLOUTS:
        names = ", ".join(f"{n} = {v:.4g}" for n, v in zip(task.context.names, worst[1], strict=True))
        raise RolloutError(
            f"the context of the task {task.name} moves the object otherwise than `relocate` says: in {different} of "
            f"{len(drawn)} rollouts, by up to {worst[0]:.3g} of the observation's range (at {names}, limit "
            f"{_MOVED:g}). Leave `relocate` out (None), so that learning takes the context as an input"
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
