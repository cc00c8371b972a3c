"""Chooses joint 7 along a flange motion so that the arm stays farthest from its limits.

A flange path leaves one degree of freedom. Joint 7 is a smooth function of time (a quintic B-spline at rest at both
ends). It minimises the largest ratio of any joint's position, velocity or acceleration to its limit. First there is a
coarse search over straight profiles on all branches of the closed-form inverse, then sequential linear programming with
a trust region (each step linearises every ratio in the spline's coefficients and minimises their maximum).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import linprog

from hw.joint_limits import JointLimits
from hw.types import Array
from sim.panda.model import BRANCHES, inverse

STEP_S = 0.01
GOOD_ENOUGH = 0.9
"""Refinement, and the search for a better posture, stop below this ratio."""

ALLOWED = 0.95
"""The largest ratio that a task path may have."""

_COEFFICIENTS = 8
_SPACING_S = 0.1
_STARTS = 8
_ITERATIONS = 40
_PATIENCE, _HOPELESS = 8, 0.2
_APART_RAD = 0.5
_BESIDE = 2  # samples
_COARSER = 4
_DEGREE = 5
_UNREACHABLE = 10.0
_JUMP_RAD = 2.0
_NEAR_TOP, _ROUNDS = 0.15, 4
_ACCELERATION_RESERVE = 0.005
"""Allowance for larger accelerations between the samples of the grid."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Joint 7 over time on one branch of the inverse, with its largest ratio."""

    duration_s: float
    coefficients: Array
    branch: int
    ratio: float  # by `_Grid.ratios`

    def q7_rad(self, t_s: Array) -> Array:
        """(N,) -> (N,)."""
        return np.asarray(_basis(t_s, self.duration_s, len(self.coefficients)) @ self.coefficients)


def profiles(t_s: Array, X_BF: Array, limits: JointLimits, q_seed_rad: Array | None = None) -> Iterator[Profile]:
    """Refined profiles for flange poses (N, 4, 4) at evenly spaced `t_s` (N,), the most promising first.

    They are computed one by one, up to eight; none if the poses are out of reach. Starts near `q_seed_rad` (7,) are
    slightly preferred.
    """
    grid = _Grid.around(t_s, X_BF, limits)
    best = np.inf
    for start in _starts(grid, q_seed_rad):
        profile = _refine(grid, start, best)
        best = min(best, profile.ratio)
        yield profile


@dataclass(frozen=True, eq=False)
class _Grid:
    """Flange poses around evenly spaced moments, to evaluate profiles.

    Each moment has a neighbour just before and just after it, so that derivatives are local: a short burst of
    acceleration is not averaged away.
    """

    t_s: Array  # (3, T) before, at and after each moment
    X_BF: Array  # (3, T, 4, 4)
    duration_s: float
    limits: JointLimits

    @classmethod
    def around(cls, t_s: Array, X_BF: Array, limits: JointLimits) -> _Grid:
        last = len(t_s) - 1
        beside = min(_BESIDE, last // 2)
        moments = np.linspace(beside, last - beside, max(round(float(t_s[-1]) / STEP_S), 4) + 1).round().astype(int)
        chosen = moments + beside * np.array([[-1], [0], [1]])
        return cls(t_s[chosen], X_BF[chosen], float(t_s[-1]), limits)

    def thinned(self, every: int) -> _Grid:
        return _Grid(self.t_s[:, ::every], self.X_BF[:, ::every], self.duration_s, self.limits)

    @property
    def count(self) -> int:
        return min(max(round(self.duration_s / _SPACING_S), 1), _COEFFICIENTS)

    def ratios(self, q_rad: Array) -> Array:
        """Joint positions (3, T, ..., 7) -> (3, T, ..., 7) ratios of position, velocity and acceleration.

        Positions far below `ALLOWED` count less, because closeness to a limit costs nothing.
        """
        h = float(self.t_s[1, 0] - self.t_s[0, 0])
        dq = (q_rad[2] - q_rad[0]) / (2.0 * h)
        ddq = (q_rad[2] - 2.0 * q_rad[1] + q_rad[0]) / h**2
        position, velocity, acceleration = self.limits.ratios(q_rad[1], dq, ddq)
        effective = np.stack([2.0 * position - ALLOWED, velocity, acceleration + _ACCELERATION_RESERVE])
        return np.asarray(np.nan_to_num(effective, nan=_UNREACHABLE))


def _starts(grid: _Grid, q_seed_rad: Array | None) -> list[Profile]:
    """Straight profiles on a coarse time grid, the best first, no two of them neighbours.

    The two sides of the shoulder (branches 2 i and 2 i + 1) move in the same way and differ only in joint positions, so
    they count as neighbours.
    """
    coarse, duration_s = grid.thinned(_COARSER), grid.duration_s
    low, high = grid.limits.q_min_rad[6], grid.limits.q_max_rad[6]
    middles, swings = np.linspace(low, high, 37)[1:-1], np.linspace(-0.9, 0.9, 7)
    middle, swing = (v.ravel() for v in np.meshgrid(middles, swings, indexing="ij"))
    share = coarse.t_s / duration_s
    bend = share**3 * (10.0 - 15.0 * share + 6.0 * share**2) - 0.5
    q = inverse(coarse.X_BF[:, :, None], middle + bend[..., None] * swing)
    worst = coarse.ratios(q).max(axis=(0, 1, -1))  # (K, branches)
    jumps = np.nan_to_num(np.abs(np.diff(q[1], axis=0)), nan=np.inf).max(axis=(0, -1)) > _JUMP_RAD
    worst[jumps] = _UNREACHABLE  # a joint would pass the seam of its range
    if q_seed_rad is not None:
        worst = worst + 0.02 * np.nan_to_num(np.abs(q[1, 0] - q_seed_rad).max(axis=-1), nan=0.0)
    starts: list[tuple[int, int]] = []
    for flat in np.argsort(worst, axis=None):
        k, branch = divmod(int(flat), BRANCHES)
        if worst[k, branch] >= _UNREACHABLE or len(starts) == _STARTS:
            break
        if all(branch // 2 != b // 2 or abs(middle[k] - middle[j]) > _APART_RAD for j, b in starts):
            starts.append((k, branch))
    place = np.linspace(-0.5, 0.5, grid.count) if grid.count > 1 else np.zeros(1)
    return [Profile(duration_s, middle[k] + swing[k] * place, b, float(worst[k, b])) for k, b in starts]


def _refine(grid: _Grid, start: Profile, to_beat: float) -> Profile:
    """Sequential linear programming: minimise the largest of all ratios. Gives up early if far from `to_beat`."""
    basis = _basis(grid.t_s.ravel(), start.duration_s, grid.count).reshape(*grid.t_s.shape, -1)
    reach, best = 0.3, start.coefficients
    worst, values, slopes = _linearised(grid, basis, best, start.branch)
    for iteration in range(_ITERATIONS):
        hopeless = iteration >= _PATIENCE and worst > to_beat + _HOPELESS
        if hopeless or reach < 0.01 or worst < GOOD_ENOUGH:
            break
        trial = best + _linear_step(values, slopes, reach)
        now, now_values, now_slopes = _linearised(grid, basis, trial, start.branch)
        if now < worst - 1e-4:
            best, worst, values, slopes = trial, now, now_values, now_slopes
            reach *= 1.3
        else:
            reach /= 2.5
    return Profile(start.duration_s, best, start.branch, worst)


def _linearised(grid: _Grid, basis: Array, coefficients: Array, branch: int) -> tuple[float, Array, Array]:
    """Largest ratio, all ratios (R,) and their slopes (R, n) by forward differences."""
    n, nudge = len(coefficients), 1e-5
    tried = np.vstack([coefficients, coefficients + nudge * np.eye(n)])
    q = inverse(grid.X_BF[:, :, None], basis @ tried.T)[..., branch, :]
    ratios = np.moveaxis(grid.ratios(q), 2, 0).reshape(n + 1, -1)
    return float(ratios[0].max()), ratios[0], ((ratios[1:] - ratios[0]) / nudge).T


def _linear_step(values: Array, slopes: Array, reach: float) -> Array:
    """The change of coefficients within `reach` that makes the largest linearised ratio smallest.

    Solved on the rows near the maximum; rows that then exceed it are added.
    """
    n = slopes.shape[1]
    bounds = [(-reach, reach)] * n + [(None, None)]
    rows: NDArray[np.bool_] = values > values.max() - _NEAR_TOP
    step = np.zeros(n)
    for _ in range(_ROUNDS):
        matrix = np.column_stack([slopes[rows], -np.ones(int(rows.sum()))])
        solution = linprog(np.r_[np.zeros(n), 1.0], A_ub=matrix, b_ub=-values[rows], bounds=bounds, method="highs-ds")
        if solution.x is None:
            break
        step = np.asarray(solution.x[:n])
        out = values + slopes @ step > solution.x[n] + 1e-6
        if not out.any():
            break
        rows |= out
    return step


def _basis(t_s: Array, duration_s: float, count: int) -> Array:
    """(N,) -> (N, count): quintic B-splines, the outer ones are combined so that velocity and acceleration are zero at
    both ends.
    """
    total = count + _DEGREE - 1
    inner = np.linspace(0.0, duration_s, total - _DEGREE + 1)
    knots = np.r_[np.zeros(_DEGREE), inner, np.full(_DEGREE, duration_s)]
    full = BSpline.design_matrix(np.clip(t_s, 0.0, duration_s), knots, _DEGREE).toarray()
    if count == 1:
        return np.asarray(full.sum(axis=1, keepdims=True))
    return np.column_stack([full[:, :3].sum(axis=1), full[:, 3:-3], full[:, -3:].sum(axis=1)])
