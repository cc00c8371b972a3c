"""The linearised double pendulum: x' = A x + B u for x = (q1, q2, q1', q2') and torques u, closed form.

With the angles small, the masses move by q1 and 2 q1 + q2 (links of 1 m), which gives
M q'' = G q - D q' + u with M = [[m1 + 4 m2, 2 m2], [2 m2, m2]], G = g [[m1 + 2 m2, m2], [m2, m2]], D = diag(b1, b2).
Every function is vectorised over the leading axes.
"""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.tasks.pendulum.params import START

GRAVITY_M_S2 = 9.81


def linearise(parameters: Array) -> tuple[Array, Array]:
    """(..., 4) of (m1, m2, b1, b2) in units -> A (..., 4, 4), B (..., 4, 2). Masses have to be positive."""
    m1, m2, b1, b2 = np.moveaxis(np.asarray(parameters, dtype=np.float64), -1, 0)
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

Fixed numbers, so that a result does not depend on the rest of the stack.
"""


def _stack(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Four (...) -> (..., 2, 2), row by row."""
    return np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)
