"""Rollouts of the pendulum, a whole stack at a time: a matrix exponential on a fixed grid, and the exact cost."""

from __future__ import annotations

from typing import Any

import numpy as np

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.tasks.pendulum.dynamics import motion
from sim.tasks.pendulum.lqr import INPUTS, STATES, closed_loop, cost, optimal
from sim.tasks.pendulum.observe import STEEPNESS
from sim.tasks.pendulum.params import OBSERVATION

BETWEEN = 4
"""Steps from one observed time to the next, so that a curve through them is smooth."""

TIMES_S: Array = frozen_array(
    np.linspace(0.0, float(OBSERVATION.times_s[-1]), (OBSERVATION.times_s.size - 1) * BETWEEN + 1)
)

HELD_RAD = 4.0 * np.pi
"""Two turns: a larger angle of the linear model is meaningless and is held at this value."""

WORST = 1e3
"""The stored excess cost if the true one is larger or infinite."""

_NOWHERE = np.full(3, np.nan)
_SURE: Array = frozen_array(np.ones(len(TIMES_S)))


def simulate_many(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None
) -> tuple[ObjectTrack, ...]:
    """Tracks of N rollouts: parameters (N, 4), action (N, 8), the rest without columns.

    A state is (q1, q2, q1', q2', excess): rad, rad/s, and (J - J*) / J* of the whole trial, the same in every row.
    """
    parameters = np.asarray(parameters, dtype=np.float64)
    gains = np.asarray(action, dtype=np.float64).reshape(-1, INPUTS, STATES)
    closed = closed_loop(parameters, gains)
    costs, (_, best) = cost(closed, gains), optimal(parameters)
    with np.errstate(over="ignore", invalid="ignore"):
        excess = np.minimum(costs / best - 1.0, WORST)
    states = _motions(closed)
    rows = np.concatenate([states, np.broadcast_to(excess[:, None, None], (*states.shape[:2], 1))], axis=-1)
    return tuple(_track(row, bool(np.isfinite(j))) for row, j in zip(rows, costs, strict=True))


def simulate(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    """One rollout: the stack of one."""
    return simulate_many(parameters[None], context[None], action[None], nuisance[None], unmodelled)[0]


def observed_many(parameters: Array, action: Array) -> Array:
    """Observations (N, 24) of N rollouts, parameters (N, 4), action (N, 8), without building tracks."""
    gains = np.asarray(action, dtype=np.float64).reshape(-1, INPUTS, STATES)
    states = _motions(closed_loop(np.asarray(parameters, dtype=np.float64), gains))
    return OBSERVATION.normalise(states[:, ::BETWEEN, list(OBSERVATION.columns)])


def _motions(closed: Array) -> Array:
    """States (N, T, 4) at `TIMES_S` in the closed loops (N, 4, 4), held once they are meaningless."""
    with np.errstate(over="ignore", invalid="ignore"):
        states = motion(closed, float(TIMES_S[1]), len(TIMES_S) - 1)
    return np.clip(np.nan_to_num(states, nan=HELD_RAD), -HELD_RAD, HELD_RAD)


def _track(rows: Array, stable: bool) -> ObjectTrack:
    if not stable:
        return ObjectTrack(TIMES_S, rows, Outcome.DIVERGED, _NOWHERE, _SURE, ("the closed loop is not stable",))
    excess = float(rows[-1, -1])
    dear = STEEPNESS * excess >= 1.0
    return ObjectTrack(TIMES_S, rows, Outcome.SETTLED, _NOWHERE, _SURE, (_price(excess),) if dear else ())


def _price(excess: float) -> str:
    worthless = 1.0 + 1.0 / STEEPNESS
    return f"it settles, but at {1.0 + excess:.3g} times the least possible cost; {worthless:g} times or more earn 0"
