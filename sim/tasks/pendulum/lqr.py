"""Linear quadratic regulators for stacks of pendulums: optimal gains, and the exact cost of any gain.

Cost: the integral of x'x + u'u over all time, from `START`.
"""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.tasks.pendulum.dynamics import linearise
from sim.tasks.pendulum.params import START

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
