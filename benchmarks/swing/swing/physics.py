"""A double pendulum with Coulomb friction, many at once; angles from hanging down, the second relative to the first.

The equations and the friction's shape are those of DFKI's double_pendulum, with lumped parameters.
"""

from __future__ import annotations

import itertools

import numpy as np

from hw.types import Array

LENGTH_M, GRAVITY_M_S2 = 0.2, 9.81  # of the first link
STEP_S, NODE_S, NODES = 0.001, 0.04, 26
SHARPNESS_S_RAD = 100.0
"""Friction at the speed v is a share of 2/pi atan(100 v) of its level."""


def swing(parameters: Array, start: Array, torque_Nm: Array) -> Array:
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
