"""Chooses the views to trust.

A view is judged by a fit without it, in the units of its own noise. Rejection starts from an agreeing half (the closed
form's subsets, then the best-fitting views) and readmits views until nothing changes, so that one spoilt view does not
exclude a good one. Joint offsets and board size are free meanwhile, so that no view is rejected because of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from calib.bundle import (
    ArmViews,
    CondensedViews,
    ErrorSizes,
    Fit,
    Model,
    Unknowns,
    arm_covariance,
    fit,
    linearise,
    squares,
)
from hw.types import Array

LIMIT = float(chi2.isf(1e-4, 6))
"""Limit of a view's squared residual, with six degrees of freedom. If errors are normal, one good view in ten thousand
exceeds it."""

MARGIN = 1.4
"""Factor on `LIMIT`, because the noise is estimated from the same few views."""

MIN_TO_FREE = 10  # agreeing views needed to free offsets and scale
_ROUNDS = 25
_ANYWHERE = 6.0 + 6.0 * float(np.log(0.05) + np.log(0.02))
"""Assumed cost of a view that may lie anywhere: its pose is off by some 3 degrees and 20 mm."""
_GENEROUS = ErrorSizes(1.0, 0.1, 1e-3)


def reject(
    moved: ArmViews, both: tuple[CondensedViews, CondensedViews], start: Unknowns, model: Model
) -> tuple[NDArray[np.bool_], NDArray[np.int64], Fit, Array]:
    """Two candidate poses of N views -> valid (N,), chosen candidate (N,), the fit, and the squared distance of both
    candidates of every view from a fit without it (2, N)."""
    n = len(both[0].X_CM)
    # the half that agrees best, with generous joint noise
    score = np.stack([_score(moved, boards, start) for boards in both])
    side = np.argmin(score, axis=0)
    order = np.argsort(score[side, np.arange(n)], kind="stable")
    half = np.zeros(n, dtype=bool)
    half[order[: max(n // 2 + 1, min(n, 5))]] = True
    settled = _settled(moved, both, start, model, half, side)
    if settled.valid.all():
        return settled.result
    # a few views alone may fit one another too well to readmit any: then a looser fit to all explains more
    every = _settled(moved, both, start, model, np.ones(n, dtype=bool), side)
    return min(settled, every, key=lambda one: one.surprise).result


@dataclass(frozen=True, eq=False)
class _Settled:
    """Kept views that no longer change."""

    valid: NDArray[np.bool_]  # (N,)
    side: NDArray[np.int64]  # (N,)
    fit: Fit
    far: Array  # (2, N)
    surprise: float  # minus twice the log density of all views, each predicted without it; rejected ones lie anywhere

    @property
    def result(self) -> tuple[NDArray[np.bool_], NDArray[np.int64], Fit, Array]:
        return self.valid, self.side, self.fit, self.far


def _settled(
    moved: ArmViews,
    both: tuple[CondensedViews, CondensedViews],
    state: Unknowns,
    model: Model,
    valid: NDArray[np.bool_],
    side: NDArray[np.int64],
) -> _Settled:
    """Fit and judge, from the views `valid`, until nothing changes."""
    rows = np.arange(len(valid))
    tried: set[bytes] = set()
    for _ in range(_ROUNDS):
        free = model if valid.sum() >= MIN_TO_FREE else Model()
        now = fit(moved.take(valid), chosen(both, side).take(valid), state, free)
        state = now.state
        judged = [_judge(moved, both[s], now, valid & (side == s)) for s in range(2)]
        far, spread = (np.stack([one[k] for one in judged]) for k in range(2))
        side = np.argmin(far, axis=0)
        again = far[side, rows] < MARGIN * LIMIT
        key = again.tobytes() + side.tobytes()
        if again.sum() < 4:
            break
        if key in tried:  # a view in and out again: it stays out
            valid = valid & again
            now = fit(moved.take(valid), chosen(both, side).take(valid), state, free)
            break
        tried.add(key)
        if (again == valid).all():
            break
        valid = again
    density = np.where(valid, far[side, rows] + spread[side, rows], _ANYWHERE)
    return _Settled(valid, side, now, far, float(density.sum()))


def chosen(both: tuple[CondensedViews, CondensedViews], side: NDArray[np.int64]) -> CondensedViews:
    """The candidate `side` (N,) of every view."""
    rows = np.arange(len(side))
    names = ("X_CM", "information", "common")
    return CondensedViews(*(np.stack([getattr(boards, name) for boards in both])[side, rows] for name in names))


def _score(moved: ArmViews, boards: CondensedViews, state: Unknowns) -> Array:
    e, _ = linearise(state, moved, boards.X_CM, Model())
    return squares(e, boards.covariance(_GENEROUS, arm_covariance(state, moved)))


def _judge(moved: ArmViews, boards: CondensedViews, now: Fit, inside: NDArray[np.bool_]) -> tuple[Array, Array]:
    """(N,) squared residual of each view, predicted without it, and (N,) log determinant of its covariance."""
    e, B = linearise(now.state, moved, boards.X_CM, now.model)
    C = boards.covariance(now.noise, arm_covariance(now.state, moved))
    lever = B @ np.linalg.inv(now.normal) @ np.swapaxes(B, 1, 2)
    # without view i: e_i' = C (C - lever)^-1 e_i with covariance C (C - lever)^-1 C, so its square is
    # e_i (C - lever)^-1 e_i; for a view outside the fit it is e_i (C + lever)^-1 e_i
    outside = C + lever
    middle = np.where(inside[:, None, None], C - lever, outside)
    logs = np.linalg.slogdet(middle)[1]
    return squares(e, middle), np.where(inside, 2 * np.linalg.slogdet(C)[1] - logs, logs)
