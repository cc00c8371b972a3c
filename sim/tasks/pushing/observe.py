"""Success, end state and reward of a push."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.tasks.pushing.params import GOAL_SCALE_M, goal_m


def succeeded(track: ObjectTrack) -> bool:
    """The bottle rests upright on the table, at any distance from the goal."""
    return track.outcome is Outcome.UPRIGHT


def end_state(track: ObjectTrack) -> Array:
    """(2,) final place of the bottle: (x, y) in the base frame, m."""
    return np.array(track.state[-1, :2])


def reward_of_success(end_m: Array, context: Array) -> Array:
    """max(0, 1 - distance from the goal / 0.2 m), for (..., 2) and (..., 2) -> (...)."""
    distance_m = np.linalg.norm(end_m - goal_m(context), axis=-1)
    return np.asarray(np.maximum(0.0, 1.0 - distance_m / GOAL_SCALE_M))


def relocate(observation: Array, context: Array) -> Array:
    """The observation (..., size) itself: it does not depend on the goal."""
    return np.array(
        np.broadcast_to(
            observation, (*np.broadcast_shapes(observation.shape[:-1], context.shape[:-1]), observation.shape[-1])
        )
    )
