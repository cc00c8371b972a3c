"""Bundle adjustment over poses: camera, board, and optionally the joint zeros and the board's scale.

A view disagrees with a prediction for two reasons: its corners are noisy, and the arm is not exactly where its joints
say. The first is the view's own information (`condense`). The second is a common twist of all its corners, far larger
than the error of one corner. Treating both as corner noise trusts near and oblique views too much. So each view counts
with

    covariance = inverse(information) + joint_rad^2 G G^T,

G the board's motion with each joint (of the flange about itself if joints are unknown). `joint_rad` is estimated with
everything else, by restricted maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.errors import UnusableViews
from calib.geometry import adjoint, difference, move
from calib.types import Forward, Mounting, View
from hw.poses import inverse
from hw.types import Array

OFFSET_PRIOR_RAD = 0.02
"""Prior standard deviation of a joint's zero: far more than that of a working arm, it only fixes unobservable
directions.
"""

SCALE_PRIOR = 0.1
JOINT_FLOOR_RAD = 1e-5
_FLANGE_LEVER_M = 0.5  # if only poses are known: 1 mrad goes with 0.5 mm
_STEP_RAD = 1e-5


@dataclass(frozen=True, eq=False)
class Motion:
    """The arm's part of every view."""

    mounting: Mounting
    forward: Forward | None
    q_rad: Array | None  # (N, n)
    X_BF: Array  # (N, 4, 4) by the reported joints
    body: Array  # (N, 6, n) twist of H in its own axes per joint; of the pose itself if joints are unknown

    @property
    def joints(self) -> int:
        """How many joint offsets could be estimated; 0 if joints are unknown."""
        return 0 if self.q_rad is None else self.q_rad.shape[1]

    def X_AH(self, offsets_rad: Array) -> Array:
        """(N, 4, 4) with corrected joints."""
        X_BF = self.X_BF
        if self.forward is not None and self.q_rad is not None and offsets_rad.any():
            X_BF = self.forward(self.q_rad + offsets_rad)
        return X_BF if self.mounting is Mounting.FIXED else inverse(X_BF)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> Motion:
        """Only the views `rows`."""
        q = None if self.q_rad is None else self.q_rad[rows]
        return replace(self, q_rad=q, X_BF=self.X_BF[rows], body=self.body[rows])


def motion(mounting: Mounting, forward: Forward | None, q_rad: Array | None, X_BF: Array | None) -> Motion:
    """From joints (N, n) and forward kinematics, or from poses (N, 4, 4)."""
    if q_rad is not None and forward is not None:
        X = forward(q_rad)
        n = q_rad.shape[1]
        ahead = forward(q_rad[:, None] + _STEP_RAD * np.eye(n))
        behind = forward(q_rad[:, None] - _STEP_RAD * np.eye(n))
        if mounting is Mounting.WRIST:
            behind, ahead = inverse(behind), inverse(ahead)
        body = np.swapaxes(difference(behind, ahead) / (2 * _STEP_RAD), 1, 2)
        return Motion(mounting, forward, q_rad, X, body)
    assert X_BF is not None
    weight = np.array([1.0] * 3 + [_FLANGE_LEVER_M] * 3)
    flange = np.broadcast_to(np.diag(weight), (len(X_BF), 6, 6))
    return Motion(mounting, None, None, X_BF, flange if mounting is Mounting.FIXED else adjoint(X_BF) @ flange)


def motion_of(views: Sequence[View], mounting: Mounting, forward: Forward | None) -> Motion:
    """From joints if all views have them and `forward` is given, else from poses. Raises UnusableViews."""
    joints = [view.q_rad for view in views if view.q_rad is not None]
    if forward is not None and len(joints) == len(views):
        return motion(mounting, forward, np.stack(joints), None)
    poses = [view.X_BF for view in views if view.X_BF is not None]
    if len(poses) == len(views):
        return motion(mounting, None, None, np.stack(poses))
    if len(joints) == len(views):
        raise UnusableViews("the views have joints, but the arm's kinematics are not known: give poses of the flange")
    raise UnusableViews("some views have joints and others do not: record all views alike")


@dataclass(frozen=True, eq=False)
class State:
    """The unknowns of a fit."""

    X_AC: Array
    X_HM: Array
    offsets_rad: Array  # (n,)
    scale: float = 1.0


@dataclass(frozen=True)
class Model:
    """Which of the optional unknowns are free."""

    offsets: tuple[int, ...] = ()  # indices of joints
    scale: bool = False  # the board's size

    @property
    def size(self) -> int:
        """Unknowns: two poses, the offsets that are free, and the scale."""
        return 12 + len(self.offsets) + int(self.scale)


def observable_joints(n: int) -> tuple[int, ...]:
    """All but the first and the last: their zeros look like a rotation of the camera's carrier or of the board."""
    return tuple(range(1, n - 1))


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit and its residuals, view by view."""

    model: Model
    state: State
    joint_rad: float
    residual: Array  # (N, 6) twist from the predicted to the seen pose, in the board's axes
    B: Array  # (N, 6, P) derivative of a prediction by the parameters
    covariance: Array  # (N, 6, 6) of the residual
    normal: Array  # (P, P)
    log_likelihood: float

    def distance2(self) -> Array:
        """(N,) squared Mahalanobis length of the residuals."""
        solved = np.linalg.solve(self.covariance, self.residual[..., None])[..., 0]
        return np.asarray(np.einsum("ni,ni->n", self.residual, solved))


def predict(state: State, moved: Motion) -> Array:
    """(N, 4, 4) predicted poses, in the camera, of a board of the stated size."""
    X = inverse(state.X_AC) @ moved.X_AH(state.offsets_rad) @ state.X_HM
    X[:, :3, 3] /= state.scale  # a larger board, farther away, looks the same
    return X


def linearise(state: State, moved: Motion, X_CM: Array, model: Model) -> tuple[Array, Array]:
    """Residual twists (N, 6) and their derivative (N, 6, P): a step s makes the residual e - B s."""
    X = predict(state, moved)
    B = np.zeros((len(X), 6, model.size))
    full = X.copy()
    full[:, :3, 3] *= state.scale
    B[:, :, :6] = -adjoint(inverse(full))
    B[:, :, 6:12] = np.eye(6)
    n = len(model.offsets)
    if n:
        B[:, :, 12 : 12 + n] = (adjoint(inverse(state.X_HM)) @ moved.body)[:, :, list(model.offsets)]
    if model.scale:
        B[:, 3:, 12 + n] = -np.einsum("nji,nj->ni", full[:, :3, :3], full[:, :3, 3])
    B[:, 3:] /= state.scale
    return difference(X, X_CM), B


def joint_spread(state: State, moved: Motion) -> Array:
    """(N, 6, n) G: the board's twist per radian of error of each joint."""
    spread: Array = adjoint(inverse(state.X_HM)) @ moved.body
    return spread


def fit(
    moved: Motion,
    X_CM: Array,
    information: Array,
    start: State,
    model: Model,
    weight: Array | None = None,
    joint_rad: float | None = None,
) -> Fit:
    """Observed poses (N, 4, 4) with their information (N, 6, 6) -> the fit; `weight` (N,) of views, None: all 1.

    `joint_rad` is estimated unless given.
    """
    own: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    w = np.ones(len(X_CM)) if weight is None else weight
    state, noise = start, (1e-4 if joint_rad is None else joint_rad)
    prior = _prior(model)
    for _ in range(4 if joint_rad is None else 1):
        G = joint_spread(state, moved)
        GG = G @ np.swapaxes(G, 1, 2)
        state = _gauss_newton(moved, X_CM, own + noise**2 * GG, state, model, w, prior)
        before = noise
        if joint_rad is None:
            e, B = linearise(state, moved, X_CM, model)
            noise = _joint_noise(e, B, own, GG, w, prior)
        if abs(np.log(noise / before)) < 0.02:
            break
    e, B = linearise(state, moved, X_CM, model)
    covariance = own + noise**2 * GG
    normal = np.einsum("nip,nir->pr", B, (np.linalg.inv(covariance) * w[:, None, None]) @ B) + prior
    return Fit(model, state, noise, e, B, covariance, normal, _log_likelihood(e, covariance, w))


def _prior(model: Model) -> Array:
    n = len(model.offsets)
    return np.diag([0.0] * 12 + [OFFSET_PRIOR_RAD**-2] * n + [SCALE_PRIOR**-2] * int(model.scale))


def _gauss_newton(
    moved: Motion, X_CM: Array, covariance: Array, state: State, model: Model, w: Array, prior: Array
) -> State:
    L = np.linalg.inv(covariance) * w[:, None, None]
    for _ in range(12):
        e, B = linearise(state, moved, X_CM, model)
        LB = L @ B
        A = np.einsum("nip,nir->pr", B, LB) + prior
        b = np.einsum("nip,ni->p", LB, e) - prior @ _optional(state, model)
        scale = np.sqrt(np.diagonal(A)) + 1e-300
        step = np.linalg.solve(A / np.outer(scale, scale) + 1e-12 * np.eye(model.size), b / scale) / scale
        state = _stepped(state, step, model)
        if np.abs(step * scale).max() < 1e-5:  # in standard deviations
            break
    return state


def _optional(state: State, model: Model) -> Array:
    """(P,) offsets and scale relative to their priors, zero for the poses."""
    tail = [np.log(state.scale)] if model.scale else []
    return np.concatenate([np.zeros(12), state.offsets_rad[list(model.offsets)], tail])


def _stepped(state: State, step: Array, model: Model) -> State:
    offsets = state.offsets_rad.copy()
    n = len(model.offsets)
    if n:
        offsets[list(model.offsets)] += np.clip(step[12 : 12 + n], -0.05, 0.05)
    scale = state.scale * float(np.exp(np.clip(step[12 + n], -0.1, 0.1))) if model.scale else state.scale
    return State(move(state.X_AC, step[:6]), move(state.X_HM, step[6:12]), offsets, scale)


def _joint_noise(e: Array, B: Array, own: Array, GG: Array, w: Array, prior: Array) -> float:
    """Restricted maximum likelihood over a grid of logarithms, refined by a parabola."""
    grid = np.linspace(np.log(JOINT_FLOOR_RAD), np.log(0.03), 25)
    # axes in which both covariances are diagonal: own is 1, GG is d
    L = np.linalg.cholesky(own)
    half = np.linalg.solve(L, GG)
    d, Q = np.linalg.eigh(np.linalg.solve(L, np.swapaxes(half, 1, 2)))
    to_axes = np.linalg.solve(np.swapaxes(L, 1, 2), Q)  # its transpose whitens
    e_axes = np.einsum("nij,ni->nj", to_axes, e).ravel()
    B_axes = (np.swapaxes(to_axes, 1, 2) @ B).reshape(-1, B.shape[2])
    variance = 1.0 + np.exp(2 * grid)[:, None] * np.maximum(d, 0.0).ravel()  # (25, 6 N)
    share = np.repeat(w, 6) / variance
    A = B_axes.T @ (share[:, :, None] * B_axes) + prior
    cost = share @ e_axes**2 + np.log(variance) @ np.repeat(w, 6) + np.linalg.slogdet(A)[1]
    k = int(np.clip(np.argmin(cost), 1, len(grid) - 2))
    left, middle, right = cost[k - 1 : k + 2]
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend if bend > 0 else (-1.0 if left < right else 1.0)
    return float(np.exp(grid[k] + np.clip(shift, -1, 1) * (grid[1] - grid[0])))


def _log_likelihood(e: Array, covariance: Array, w: Array) -> float:
    solved = np.linalg.solve(covariance, e[..., None])[..., 0]
    return -0.5 * float((np.einsum("ni,ni->n", e, solved) + np.linalg.slogdet(covariance)[1]) @ w)
