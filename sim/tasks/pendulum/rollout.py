"""The linearised double pendulum, its LQR control, and rollouts of the two."""

from __future__ import annotations

from typing import Any

import numpy as np

from hw.dynamics import GRAVITY_M_S2
from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.tasks.pendulum.params import OBSERVATION, PARAMETERS, START

STEEPNESS = 10.0
"""Reward lost per excess over the least possible cost: at 0.1 it is 0."""

WORTHLESS = 2.0 / STEEPNESS
"""Costs saturate here and score 0: larger ones say nothing about the actions that earn more."""


def succeeded(track: ObjectTrack) -> bool:
    """The closed loop is stable: the pendulum comes to rest upright."""
    return track.outcome is Outcome.SETTLED


def end_state(track: ObjectTrack) -> Array:
    """(1,) excess of the cost, (J - J*) / J*, at most `WORTHLESS`: the last column of the track."""
    return np.minimum(track.state[-1, -1:], WORTHLESS)


def reward_of_success(excess: Array, context: Array) -> Array:
    """1 - 10 (cost - least cost) / least cost, at least 0, for (..., 1) -> (...)."""
    return np.clip(1.0 - STEEPNESS * excess[..., 0], 0.0, 1.0)


def relocate(observation: Array, context: Array) -> Array:
    """The observation itself: every trial starts from the same state."""
    return observation


def linearise(parameters: Array) -> tuple[Array, Array]:
    """(..., 4) of (m1, m2, b1, b2) in units -> A (..., 4, 4), B (..., 4, 2). Masses have to be positive."""
    p = PARAMETERS.columns(parameters)
    m1, m2, b1, b2 = p["m1"], p["m2"], p["b1"], p["b2"]
    lead = m1.shape
    inverse_M = _stack(1.0 / m1, -2.0 / m1, -2.0 / m1, 4.0 / m1 + 1.0 / m2)
    G = GRAVITY_M_S2 * _stack(m1 + 2.0 * m2, m2, m2, m2)
    D = _stack(b1, np.zeros(lead), np.zeros(lead), b2)
    A, B = np.zeros((*lead, 4, 4)), np.zeros((*lead, 4, 2))
    A[..., :2, 2:] = np.eye(2)
    A[..., 2:, :2] = inverse_M @ G
    A[..., 2:, 2:] = -inverse_M @ D
    B[..., 2:, :] = inverse_M
    return A, B


def motion(closed: Array, dt_s: float, steps: int) -> Array:
    """States from `START` of x' = `closed` x, (..., 4, 4), every `dt_s`: (..., steps + 1, 4)."""
    step = exponential(closed * dt_s)
    states = [np.broadcast_to(START[:, None], (*closed.shape[:-2], 4, 1))]
    for _ in range(steps):
        states.append(step @ states[-1])
    return np.stack([s[..., 0] for s in states], axis=-2)


def exponential(matrices: Array) -> Array:
    """Matrix exponentials of a stack (..., n, n): a Taylor series after scaling, then squaring.

    All matrices have the same scaling, so that the whole stack is one product; each is exact to rounding.
    """
    n = matrices.shape[-1]
    scaled = matrices / 2.0**_HALVINGS
    total = term = np.broadcast_to(np.eye(n), matrices.shape)
    for order in range(1, _ORDER + 1):
        term = term @ scaled / order
        total = total + term
    for _ in range(_HALVINGS):
        total = total @ total
    return np.asarray(total)


_HALVINGS, _ORDER = 9, 12
"""Norms up to 100 become 0.2, where twelve terms are exact to rounding.

The numbers are fixed, so that a result does not depend on the rest of the stack."""


def _stack(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Four (...) -> (..., 2, 2), row by row."""
    return np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)


STATES, INPUTS = 4, 2


def optimal(parameters: Array) -> tuple[Array, Array]:
    """(..., 4) -> the optimal gain K (..., 2, 4) and its cost J* (...)."""
    A, B = linearise(parameters)
    P = riccati(A, B)
    return np.swapaxes(B, -1, -2) @ P, _cost(P)


def riccati(A: Array, B: Array) -> Array:
    """The stabilising P of A'P + PA - PBB'P + I = 0, (..., 4, 4).

    From the stable eigenvectors (U; V) of the Hamiltonian: P = V U^-1 (Laub 1979 has the same with Schur vectors).
    `scipy.linalg.solve_continuous_are` agrees to 1e-9 and takes one matrix at a time.
    """
    At, Bt = np.swapaxes(A, -1, -2), np.swapaxes(B, -1, -2)
    eye = np.broadcast_to(np.eye(STATES), A.shape)
    hamiltonian = np.concatenate([np.concatenate([A, -B @ Bt], axis=-1), np.concatenate([-eye, -At], axis=-1)], axis=-2)
    values, vectors = np.linalg.eig(hamiltonian)
    stable = np.argsort(values.real, axis=-1)[..., None, :STATES]
    chosen = np.take_along_axis(vectors, stable, axis=-1)
    U, V = chosen[..., :STATES, :], chosen[..., STATES:, :]
    P = np.swapaxes(np.linalg.solve(np.swapaxes(U, -1, -2), np.swapaxes(V, -1, -2)), -1, -2).real
    return np.asarray(0.5 * (P + np.swapaxes(P, -1, -2)))


def closed_loop(parameters: Array, gains: Array) -> Array:
    """(..., 4), (..., 2, 4) -> A - BK, (..., 4, 4)."""
    A, B = linearise(parameters)
    return np.asarray(A - B @ gains)


def cost(closed: Array, gains: Array) -> Array:
    """J of the gains (..., 2, 4) in the closed loop (..., 4, 4): (...), infinite if the loop is unstable.

    From the Lyapunov equation C'P + PC + I + K'K = 0, written out as 16 linear equations.
    """
    stable = np.linalg.eigvals(closed).real.max(axis=-1) < -_STABLE
    safe = np.where(stable[..., None, None], closed, -np.eye(STATES))
    Ct, eye = np.swapaxes(safe, -1, -2), np.eye(STATES)
    left = np.einsum("...ab,cd->...acbd", Ct, eye) + np.einsum("...cd,ab->...acbd", Ct, eye)
    right = np.eye(STATES) + np.swapaxes(gains, -1, -2) @ gains
    n = STATES * STATES
    solved = np.linalg.solve(left.reshape(*safe.shape[:-2], n, n), -right.reshape(*right.shape[:-2], n, 1))
    return np.where(stable, _cost(solved.reshape(safe.shape)), np.inf)


def excess(parameters: Array, gains: Array) -> Array:
    """(J - J*) / J* of gains (..., 2, 4) in pendulums (..., 4): (...), at least 0, up to rounding."""
    _, best = optimal(parameters)
    return np.asarray(cost(closed_loop(parameters, gains), gains) / best - 1.0)


def _cost(P: Array) -> Array:
    return np.asarray(np.einsum("i,...ij,j->...", START, P, START))


_STABLE = 1e-9
"""A loop counts as stable only if it decays faster than this rate (1/s)."""


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
