"""Success, end state and reward of a scoop, and how its observation depends on the piece's place."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from perception.blade import BLADE_LENGTH_M
from perception.types import ObjectTrack, Outcome
from sim.tasks.scooping.params import OBSERVATION, REFERENCE_CONTEXT

_FAR_M = 0.05
_FAR_COST = 0.2


def succeeded(track: ObjectTrack) -> bool:
    """The piece ended on the blade: over 1 mm above its face and inside its outline, or held by the neck."""
    return track.outcome is Outcome.ON_BLADE


def end_state(track: ObjectTrack) -> Array:
    """(2,) final place of the piece on the blade: (x, y) in the tool frame, m."""
    return np.array(track.end_in_tool_m[:2])


def reward_of_success(end_in_tool_m: Array, context: Array) -> Array:
    """1 - 0.2 min(1, distance from the blade's centre / 5 cm) (public code), for (..., 2) -> (...)."""
    distance_m = np.hypot(end_in_tool_m[..., 0] + BLADE_LENGTH_M / 2, end_in_tool_m[..., 1])
    return 1.0 - _FAR_COST * np.minimum(1.0, distance_m / _FAR_M)


def relocate(observation: Array, context: Array) -> Array:
    """The observation (..., size) at the reference context, moved to `context` (..., 2): the motion starts relative to
    the piece and the table is uniform, so everything moves along.
    """
    states = OBSERVATION.denormalise(observation)
    return OBSERVATION.normalise(states + (context - REFERENCE_CONTEXT)[..., None, :])
