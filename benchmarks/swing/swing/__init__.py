"""Swing: a double pendulum with Coulomb friction is driven for one second, and its outer link should end at an angle.

A task package as another lab would write it (docs/guide/add-a-task.md). Its real trials are recorded runs.

The angles count from hanging down, the second relative to the first. The equations and the friction's shape are those
of DFKI's double_pendulum, with lumped parameters.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.solvers.grid import grid_solver
from sim.tasks.task import AdaptationSettings, Observation, Task
from sim.types import Dimension, Space

LENGTH_M, GRAVITY_M_S2 = 0.2, 9.81  # of the first link
STEP_S, NODE_S, NODES = 0.001, 0.04, 26
SHARPNESS_S_RAD = 100.0
"""Friction at the speed v is a share of 2/pi atan(100 v) of its level."""


def integrate(parameters: Array, start: Array, torque_Nm: Array) -> Array:
    """(..., NODES, 4) angles in rad and rates in rad/s every `NODE_S`, for one second.

    From `start` (..., 4), with torques (..., NODES, 2) at the same times, linear in between. `parameters` (..., 8) are
    those of `swing.PARAMETERS`, then the viscous friction of both joints in Nm s. The leading shapes broadcast.
    """
    lead = np.broadcast_shapes(parameters.shape[:-1], start.shape[:-1], torque_Nm.shape[:-2])
    p, torque = np.moveaxis(parameters, -1, 0), np.moveaxis(torque_Nm, (-2, -1), (0, 1))
    state = np.moveaxis(np.broadcast_to(start, (*lead, 4)), -1, 0)
    seen, each = [state], round(NODE_S / STEP_S)
    for here, after in itertools.pairwise(torque):
        for i in range(each):
            u0, u1, u2 = (here + (i + part) / each * (after - here) for part in (0.0, 0.5, 1.0))
            k1 = _rates(p, state, u0)
            k2 = _rates(p, state + 0.5 * STEP_S * k1, u1)
            k3 = _rates(p, state + 0.5 * STEP_S * k2, u1)
            k4 = _rates(p, state + STEP_S * k3, u2)
            state = state + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        seen.append(state)
    return np.moveaxis(np.stack(seen), (0, 1), (-2, -1))


def _rates(p: Array, state: Array, torque: Array) -> Array:
    """(4, ...) time derivatives of the states (4, ...)."""
    (j1, lever, g1, g2, cf1, cf2, b1, b2), (q1, q2, v1, v2) = p, state
    j2, bend, bend_sine = g2 * lever, LENGTH_M * g2 * np.cos(q2), LENGTH_M * g2 * np.sin(q2)
    outer = GRAVITY_M_S2 * g2 * np.sin(q1 + q2)
    f1 = torque[0] - GRAVITY_M_S2 * g1 * np.sin(q1) - outer + bend_sine * v2 * (2.0 * v1 + v2)
    f2 = torque[1] - outer - bend_sine * v1 * v1
    f1 = f1 - b1 * v1 - cf1 * 2.0 / np.pi * np.arctan(SHARPNESS_S_RAD * v1)
    f2 = f2 - b2 * v2 - cf2 * 2.0 / np.pi * np.arctan(SHARPNESS_S_RAD * v2)
    m11, m12 = j1 + j2 + 2.0 * bend, j2 + bend
    det = j1 * j2 - bend * bend
    return np.stack([v1, v2, (j2 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det])


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
    """The effects that a world may add: none."""


def simulate(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    """One second (see `sim.tasks.task.Simulate`)."""
    return track_of(integrate(np.append(parameters, VISCOUS_N_M_S), action[:4], action[4:].reshape(NODES, 2)))


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
