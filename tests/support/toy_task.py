"""A task that costs microseconds: a piece is pushed, and scooped when the action suits the parameters.

Four parameters (one logarithmic, one whole), two actions, one nuisance, a context that moves everything.
The reward of a success depends on where the piece ends on the blade.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from perception.types import ObjectTrack, Outcome
from sim.rollouts.run import Rollouts
from sim.tasks.task import AdaptationSettings, Observation, ReuseRules, Task
from sim.types import Dimension, Space

PARAMETERS = Space(
    (
        Dimension("mu", "", 0.2, 0.4),
        Dimension("e", "Pa", 1e4, 1e6, "log"),
        Dimension("g", "", 0, 1, "integer"),
        Dimension("h", "cm", 1.5, 2.5),
    )
)
MARGIN = Space(
    (
        Dimension("mu", "", 0.15, 0.45),
        Dimension("e", "Pa", 5e3, 2e6, "log"),
        Dimension("g", "", 0, 2, "integer"),
        Dimension("h", "cm", 1.2, 2.8),
    )
)
CONTEXT = Space((Dimension("x", "m", 0.6, 0.7), Dimension("y", "m", -0.03, 0.03)))
ACTION = Space((Dimension("pitch", "rad", 0.0, 0.2), Dimension("speed", "m/s", 0.4, 0.8)))
NUISANCE = Space((Dimension("yaw", "rad", -1.0, 1.0),))
TIMES_S = np.array([0.0, 0.2, 0.4, 0.8])


@dataclass(frozen=True)
class Unmodelled:
    """What no parameter expresses."""

    pitch_bias_rad: float = 0.0
    wind_m: float = 0.0


def best_action(parameters: np.ndarray) -> np.ndarray:
    """The action that scoops best, normalised: the ground truth of the tests."""
    mu, _, g, h = PARAMETERS.normalise(parameters)
    return np.array([0.15 + 0.7 * mu, 0.25 + 0.4 * h + 0.1 * g])


def simulate(
    parameters: np.ndarray, context: np.ndarray, action: np.ndarray, nuisance: np.ndarray, unmodelled: Any = None
) -> ObjectTrack:
    effects = unmodelled or Unmodelled()
    executed = ACTION.normalise(action + np.array([effects.pitch_bias_rad, 0.0]))
    miss = executed - best_action(parameters)
    softness = PARAMETERS.normalise(parameters)[1]
    radius = 0.45 + 0.03 * nuisance[0]
    scooped = float(np.hypot(*miss)) < radius
    reach = 0.05 + 0.3 * miss[0] + 0.1 * executed[1]
    x = context[0] + reach * TIMES_S / TIMES_S[-1] + 0.02 * (softness - 0.5) * (TIMES_S > 0.1)
    y = context[1] + 0.05 * miss[1] * TIMES_S + effects.wind_m * TIMES_S
    state = np.stack([x, y, np.full(4, 0.03 if scooped else 0.01)], axis=1)
    end = np.array([0.05 * float(np.hypot(*miss)) / radius, 0.0, 0.02])
    outcome = Outcome.ON_BLADE if scooped else Outcome.ON_TABLE
    return ObjectTrack(TIMES_S, state, outcome, end, np.ones(4))


def end_state(track: ObjectTrack) -> np.ndarray:
    return track.end_in_tool_m[:1]


def succeeded(track: ObjectTrack) -> bool:
    return track.outcome is Outcome.ON_BLADE


def reward_of_success(end: np.ndarray, context: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 - 0.6 * np.minimum(1.0, np.abs(end[..., 0]) / 0.05) + 0.0 * context[..., 0])


def relocate(observation: np.ndarray, context: np.ndarray) -> np.ndarray:
    states = OBSERVATION.denormalise(observation)
    return OBSERVATION.normalise(states + (context - CONTEXT_REFERENCE)[..., None, :])


def rest_pose(context: np.ndarray, parameters: np.ndarray, nuisance: np.ndarray, unmodelled: Any) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, 3] = context
    return pose


def time_step_s(unmodelled: Any) -> float:
    return 0.001


CONTEXT_REFERENCE = np.array([0.65, 0.0])
OBSERVATION = Observation(
    times_s=TIMES_S,
    columns=(0, 1),
    low=np.array([0.5, -0.1]),
    high=np.array([1.1, 0.1]),
    noise_mean=np.array([0.002, 0.0]),
    noise_std=np.array([0.002, 0.002]),
)

TOY = Task(
    name="toy",
    title="Toy",
    parameters=PARAMETERS,
    margin=MARGIN,
    context=CONTEXT,
    action=ACTION,
    nuisance=NUISANCE,
    action_noise=np.array([0.01, 0.02]),
    observation=OBSERVATION,
    reuse=ReuseRules(0.16, first_budget=1_200, least_budget=300, max_budget=4_000, discount=0.9),
    adaptation=AdaptationSettings(
        horizon=8, delta=0.15, discount=0.9, threshold=0.5, trials_per_iteration=2, learning_rate=1e-3
    ),
    unmodelled=Unmodelled,
    simulate=simulate,
    reference_context=CONTEXT_REFERENCE,
    relocate=relocate,
    succeeded=succeeded,
    end_state=end_state,
    reward_of_success=reward_of_success,
    object_name="toy piece",
)


@dataclass
class Counted:
    """`simulate`, counted; after `most` rollouts the power fails."""

    most: float = np.inf
    count: int = 0

    def __call__(
        self,
        parameters: np.ndarray,
        context: np.ndarray,
        action: np.ndarray,
        nuisance: np.ndarray,
        unmodelled: Any = None,
    ) -> ObjectTrack:
        if self.count >= self.most:
            raise RuntimeError("power cut")
        self.count += 1
        return simulate(parameters, context, action, nuisance, unmodelled)

    @property
    def task(self) -> Task:
        return dataclasses.replace(TOY, simulate=self)


def equal_rollouts(one: Rollouts, two: Rollouts) -> bool:
    """Whether both hold the same numbers."""
    return one.columns.keys() == two.columns.keys() and all(
        np.array_equal(column, two.columns[name], equal_nan=name == "end_state") for name, column in one.columns.items()
    )
