"""Swing: a double pendulum with Coulomb friction is driven for one second, and its outer link should end at an angle.

A task package as another lab would write it (docs/guide/add-a-task.md). Its reality are recorded runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.solvers.grid import grid_solver
from sim.tasks.task import AdaptationSettings, Observation, Task
from sim.types import Dimension, Space
from swing.physics import NODE_S, NODES, swing

NEAR_RAD = 0.5
"""An outer link that ends this far from its goal earns nothing."""

VISCOUS_N_M_S = (0.002, 0.001)

PARAMETERS = Space(
    (
        Dimension(
            "j1", "kg m^2", 0.04, 0.09, plain="inner inertia", meaning="about joint 1, the outer mass at joint 2"
        ),
        Dimension("lever", "m", 0.26, 0.42, plain="outer lever", meaning="outer inertia over outer moment"),
        Dimension("g1", "kg m", 0.15, 0.30, plain="inner moment", meaning="mass times lever about joint 1"),
        Dimension("g2", "kg m", 0.10, 0.20, plain="outer moment", meaning="mass times lever about joint 2"),
        Dimension("cf1", "N m", 0.0, 0.35, plain="inner friction", meaning="Coulomb friction of joint 1"),
        Dimension("cf2", "N m", 0.0, 0.35, plain="outer friction", meaning="Coulomb friction of joint 2"),
    )
)
CONTEXT = Space((Dimension("goal", "rad", -1.0, 1.0, plain="goal", meaning="where the outer link should point"),))
STATE = ("q1", "q2", "v1", "v2")
ACTION = Space(
    (
        Dimension("q1", "rad", -4.0, 4.0, plain="angle 1", meaning="of joint 1 at the start"),
        Dimension("q2", "rad", -4.0, 4.0, plain="angle 2", meaning="of joint 2 at the start"),
        Dimension("v1", "rad/s", -20.0, 20.0, plain="speed 1", meaning="of joint 1 at the start"),
        Dimension("v2", "rad/s", -20.0, 20.0, plain="speed 2", meaning="of joint 2 at the start"),
        *(
            Dimension(
                f"tau{joint}_{node}", "N m", -6.0, 6.0, plain=f"torque {joint} at {node * NODE_S:g} s", meaning=""
            )
            for node in range(NODES)
            for joint in (1, 2)
        ),
    )
)


@dataclass(frozen=True)
class Unmodelled:
    """What a world may add: nothing."""


def simulate(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    """One second (see `sim.tasks.task.Simulate`)."""
    return track_of(swing(np.append(parameters, VISCOUS_N_M_S), action[:4], action[4:].reshape(NODES, 2)))


def track_of(state: Array) -> ObjectTrack:
    """The track of states (NODES, 4)."""
    return ObjectTrack(
        np.arange(NODES, dtype=np.float64) * NODE_S, state, Outcome.SETTLED, np.full(3, np.nan), np.ones(NODES)
    )


TASK = Task(
    name="swing",
    title="drive a double pendulum for a second",
    object_name="pendulum",
    parameters=PARAMETERS,
    margin=PARAMETERS,
    context=CONTEXT,
    action=ACTION,
    nuisance=Space(()),
    action_noise=frozen_array(np.zeros(len(ACTION))),
    observation=Observation(
        times_s=frozen_array(0.08 * np.arange(1, 13)),
        columns=(0, 1),
        low=frozen_array([-4.0, -4.0]),
        high=frozen_array([4.0, 4.0]),
        noise_mean=frozen_array(np.zeros(2)),
        noise_std=frozen_array([0.002, 0.002]),
        curves=("q1 [rad]", "q2 [rad]"),
    ),
    adaptation=AdaptationSettings(
        horizon=5, delta=0.15, discount=0.9, threshold=0.5, trials_per_iteration=2, learning_rate=1e-3
    ),
    unmodelled=Unmodelled,
    simulate=simulate,
    reference_context=frozen_array([0.0]),
    relocate=lambda observation, context: observation,
    succeeded=lambda track: track.outcome is Outcome.SETTLED,
    end_state=lambda track: track.state[-1, :2],
    reward_of_success=lambda end, context: np.maximum(
        0.0, 1.0 - np.abs(end[..., 0] + end[..., 1] - context[..., 0]) / NEAR_RAD
    ),
    exact=grid_solver,
)
