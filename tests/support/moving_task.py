"""A task whose context moves things: a ball rolls from a start that differs from trial to trial, to stop at 1 m.

The faster the ball and the slipperier the floor, the farther it rolls. There is no `Task.relocate`: a ball that starts
far back meets a carpet, which stops it sooner.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.tasks.pendulum import TASK as PENDULUM
from sim.tasks.task import Observation, Task
from sim.types import Dimension, Space

TIMES_S: Array = frozen_array([0.0, 0.5, 1.0])

CARPET_M = 0.3
"""The carpet ends here: behind it, friction is doubled."""


@dataclass(frozen=True)
class Unmodelled:
    """What a world may add."""

    wind_m: float = 0.0


def simulate(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    """The ball loses speed evenly."""
    effects = unmodelled or Unmodelled()
    rough = 2.0 if context[0] < CARPET_M else 1.0
    end_m = float(context[0] + action[0] ** 2 / (rough * parameters[0]) + effects.wind_m)
    x_m = context[0] + (end_m - context[0]) * TIMES_S**0.5
    return ObjectTrack(TIMES_S, x_m[:, None], Outcome.SETTLED, np.full(3, np.nan), np.ones(len(TIMES_S)))


def reward_of_success(end: Array, context: Array) -> Array:
    """1 where the ball stops at 1 m, whatever its start."""
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(end[..., 0] - 1.0) / 0.5) + 0.0 * context[..., 0])


def end_state(track: ObjectTrack) -> Array:
    return np.asarray(track.state[-1, :1])


def succeeded(track: ObjectTrack) -> bool:
    return track.outcome is Outcome.SETTLED


TASK: Task = replace(
    PENDULUM,
    name="rolling",
    title="Rolling",
    parameters=Space((Dimension("mu", "", 0.8, 1.6),)),
    margin=Space((Dimension("mu", "", 0.6, 2.0),)),
    context=Space((Dimension("start", "m", 0.0, 0.6),)),
    action=Space((Dimension("speed", "m/s", 0.3, 1.5),)),
    action_noise=frozen_array([0.01]),
    observation=Observation(
        times_s=TIMES_S,
        columns=(0,),
        low=frozen_array([0.0]),
        high=frozen_array([2.0]),
        noise_mean=frozen_array([0.0]),
        noise_std=frozen_array([0.002]),
        curves=("x [m]",),
    ),
    unmodelled=Unmodelled,
    simulate=simulate,
    simulate_many=None,
    reference_context=frozen_array([0.3]),
    relocate=None,
    end_state=end_state,
    succeeded=succeeded,
    reward_of_success=reward_of_success,
    object_name="ball",
    plausible={},
    report=None,
    exact=None,
)


def best_speed(mu: float, start_m: float) -> float:
    """The speed in m/s with which the ball stops at 1 m."""
    rough = 2.0 if start_m < CARPET_M else 1.0
    return float(np.sqrt((1.0 - start_m) * mu * rough))


@dataclass
class Counted:
    """`simulate`, counted."""

    count: int = field(default=0)

    def __call__(self, *values: Any) -> ObjectTrack:
        self.count += 1
        return simulate(*values)
