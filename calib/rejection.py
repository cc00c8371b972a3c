"""Chooses the views to trust.

A view is judged by a fit without it, in the units of its own noise. Rejection starts from an agreeing half (the closed
form's subsets, then the best-fitting views) and readmits views until nothing changes, so that one spoilt view does not
exclude a good one. Joint offsets and board size are free meanwhile, so that no view is rejected because of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from calib.bundle import Fit, Model, Motion, State, fit, joint_spread, linearise
from hw.types import Array

LIMIT = float(chi2.isf(1e-4, 6))
"""Limit of a view's squared residual, with six degrees of freedom: one good view in ten thousand exceeds it, if normal.
"""

MARGIN = 1.6
"""Factor on `LIMIT`: the noise is estimated from the same few views."""

MIN_TO_FREE = 10  # agreeing views needed to free offsets and scale
_ROUNDS = 25


def reject(
    moved: Motion, candidates: Array, information: Array, start: State, model: Model
) -> tuple[NDArray[np.bool_], NDArray[np.int64], Fit, Array]:
    """Candidate poses (2, N, 4, 4) and information (2, N, 6, 6) -> kept (N,), chosen candidate (N,), the fit, and the
    squared distance of both candidates of every view from a fit without it (2, N)."""
    n = candidates.shape[1]
    rows = np.arange(n)
    side = np.zeros(n, dtype=np.int64)
    plain = Model()
    # start: the half that agrees best, with generous joint noise
    score = np.stack([_score(moved, candidates[s], information[s], start, 1e-3) for s in range(2)])
    side = np.argmin(score, axis=0)
    order = np.argsort(score[side, rows], kind="stable")
    kept = np.zeros(n, dtype=bool)
    kept[order[: max(n // 2 + 1, min(n, 5))]] = True
    seen: set[bytes] = set()
    state = start
    for _ in range(_ROUNDS):
        free = model if kept.sum() >= MIN_TO_FREE else plain
        X, H = candidates[side, rows], information[side, rows]
        now = fit(moved.take(kept), X[kept], H[kept], state, free)
        state = now.state
        both = np.stack([_judge(moved, candidates[s], information[s], now, kept & (side == s)) for s in range(2)])
        side = np.argmin(both, axis=0)
        again = both[side, rows] < MARGIN * LIMIT
        key = again.tobytes() + side.tobytes()
        if key in seen or again.sum() < 4:
            break
        seen.add(key)
        if (again == kept).all():
            break
        kept = again
    return kept, side, now, both


def _score(moved: Motion, X_CM: Array, information: Array, state: State, joint_rad: float) -> Array:
    e, _ = linearise(state, moved, X_CM, Model())
    G = joint_spread(state, moved)
    C = np.linalg.inv(information) + joint_rad**2 * G @ np.swapaxes(G, 1, 2)
    return np.asarray(np.einsum("ni,ni->n", e, np.linalg.solve(C, e[..., None])[..., 0]))


def _judge(moved: Motion, X_CM: Array, information: Array, now: Fit, inside: NDArray[np.bool_]) -> Array:
    """(N,) squared residual of each view, predicted without it."""
    e, B = linearise(now.state, moved, X_CM, now.model)
    G = joint_spread(now.state, moved)
    C = np.linalg.inv(information) + now.joint_rad**2 * G @ np.swapaxes(G, 1, 2)
    P = np.linalg.inv(now.normal)
    lever = B @ P @ np.swapaxes(B, 1, 2)
    # without view i: e_i' = C (C - lever)^-1 e_i with covariance C (C - lever)^-1 C, so its square is
    # e_i (C - lever)^-1 e_i; for a view outside the fit it is e_i (C + lever)^-1 e_i
    total = np.where(inside[:, None, None], C - lever, C + lever)
    return np.asarray(np.einsum("ni,ni->n", e, np.linalg.solve(total, e[..., None])[..., 0]))
