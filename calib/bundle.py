"""Bundle adjustment over poses: cameras, board, and optionally the joint zeros and the board's scale.

A view disagrees with a prediction for three reasons. Each of its corners has noise of its own, which is the view's own
information (`condense`). They also share errors, because the lens is not quite as stated, the print is bent, or an edge
is blurred. A smooth error of a tenth of a pixel tilts a board by more than the noise of fifty corners does. And the arm
is not exactly where its joints say, which is a common twist of all corners. So each view counts with

    covariance = corners^2 inverse(information) + view_px^2 common + joint_rad^2 G G^T,

where `common` is the pose's covariance by smooth errors of one pixel, and G is the board's motion with each joint (or
with a motion of the flange about itself, if joints are unknown). The sizes are estimated with everything else, by
restricted maximum likelihood. Plain weights (`Weights.PIXELS`) leave out the last two terms, which gives a bundle
adjustment over pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.errors import UnusableViews
from calib.geometry import adjoint, difference, move
from calib.types import Forward, Mounting, View, Weights
from hw.poses import inverse
from hw.types import Array

OFFSET_PRIOR_RAD = 0.02
"""Prior standard deviation of a joint's zero. It is far larger than that of a working arm, and only fixes unobservable
directions."""

SCALE_PRIOR = 0.1
_FLANGE_LEVER_M = 0.5  # if only poses are known: 1 mrad goes with 0.5 mm
_STEP_RAD = 1e-5
_START_PX, _START_RAD = 0.1, 2e-4
_EXPECTED = np.log([0.05, 2e-4])
_WIDTH = 2.0  # of the prior of both logarithms
_FLOORS, _CEILINGS = (1e-4, 1e-6), (3.0, 0.01)
_ROUNDS, _SCORINGS = 5, 12


Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ArmViews:
    """The arm's part of every view."""

    mounting: Mounting
    forward: Forward | None
    q_rad: Array | None  # (N, n)
    X_BF: Array  # (N, 4, 4) by the reported joints
    body: Array  # (N, 6, n) twist of H in its own axes per joint; of the pose itself if joints are unknown
    camera: Rows  # (N,) index of the view's camera
    posture: Rows  # (N,) index of the arm's posture; views of one posture are left out together

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

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> ArmViews:
        """Only the views `rows`."""
        q = None if self.q_rad is None else self.q_rad[rows]
        names = ("X_BF", "body", "camera", "posture")
        return replace(self, q_rad=q, **{name: getattr(self, name)[rows] for name in names})


def motion(mounting: Mounting, forward: Forward | None, q_rad: Array | None, X_BF: Array | None) -> ArmViews:
    """The motion from joints (N, n) and kinematics, or from poses (N, 4, 4), for one camera and one posture in each
    view.
    """
    if q_rad is not None and forward is not None:
        X = forward(q_rad)
        n = q_rad.shape[1]
        ahead = forward(q_rad[:, None] + _STEP_RAD * np.eye(n))
        behind = forward(q_rad[:, None] - _STEP_RAD * np.eye(n))
        if mounting is Mounting.WRIST:
            behind, ahead = inverse(behind), inverse(ahead)
        body = np.swapaxes(difference(behind, ahead) / (2 * _STEP_RAD), 1, 2)
        return ArmViews(mounting, forward, q_rad, X, body, *_one_camera(len(X)))
    assert X_BF is not None
    weight = np.array([1.0] * 3 + [_FLANGE_LEVER_M] * 3)
    flange = np.broadcast_to(np.diag(weight), (len(X_BF), 6, 6))
    body = flange if mounting is Mounting.FIXED else adjoint(X_BF) @ flange
    return ArmViews(mounting, None, None, X_BF, body, *_one_camera(len(X_BF)))


def _one_camera(views: int) -> tuple[Rows, Rows]:
    return np.zeros(views, dtype=np.int64), np.arange(views)


def motion_of(views: Sequence[View], mounting: Mounting, forward: Forward | None) -> ArmViews:
    """The motion from joints if all views have them and `forward` is given, else from poses. Raises UnusableViews."""
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
class Unknowns:
    """The unknowns of a fit."""

    X_AC: Array  # (C, 4, 4)
    X_HM: Array  # (4, 4)
    offsets_rad: Array  # (n,)
    scale: float = 1.0


@dataclass(frozen=True)
class Model:
    """Which of the optional unknowns are free, for how many cameras, and how views are weighed."""

    offsets: tuple[int, ...] = ()  # indices of joints
    scale: bool = False  # the board's size
    cameras: int = 1
    weights: Weights = Weights.ARM_AND_VIEWS

    @property
    def poses(self) -> int:
        """Unknowns of the poses: the cameras', then the board's."""
        return 6 * self.cameras + 6

    @property
    def size(self) -> int:
        """All unknowns: poses, the offsets that are free, and the scale."""
        return self.poses + len(self.offsets) + int(self.scale)


@dataclass(frozen=True, eq=False)
class CondensedViews:
    """N views, condensed to a pose each."""

    X_CM: Array  # (N, 4, 4)
    information: Array  # (N, 6, 6) inverse covariance of the twist in the board's axes, by the noise of single corners
    common: Array  # (N, 6, 6) covariance of that twist by smooth errors of 1 px along an axis

    def take(self, rows: NDArray[np.bool_] | Rows) -> CondensedViews:
        """Only the views `rows`."""
        return CondensedViews(self.X_CM[rows], self.information[rows], self.common[rows])

    def covariance(self, noise: ErrorSizes, GG: Array) -> Array:
        """Covariances (N, 6, 6) of the residual twists; `GG` (N, 6, 6) is G G^T."""
        own = np.asarray(np.linalg.inv(self.information))
        covariance: Array = noise.corners**2 * own + noise.view_px**2 * self.common + noise.joint_rad**2 * GG
        return covariance


@dataclass(frozen=True)
class ErrorSizes:
    """One standard deviation of each kind of error."""

    corners: float  # times what the noise of single corners says
    view_px: float  # of the errors common to a view's corners, along an axis
    joint_rad: float


def observable_joints(n: int) -> tuple[int, ...]:
    """All joints but the first and the last, whose zeros look like a rotation of the camera's carrier or the board."""
    return tuple(range(1, n - 1))


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit and its residuals, view by view."""

    model: Model
    state: Unknowns
    noise: ErrorSizes
    residual: Array  # (N, 6) twist from the predicted to the seen pose, in the board's axes
    B: Array  # (N, 6, P) derivative of a prediction by the parameters
    covariance: Array  # (N, 6, 6) of the residual
    normal: Array  # (P, P)
    log_likelihood: float
    posture: Rows  # (N,)


def predict(state: Unknowns, moved: ArmViews) -> Array:
    """(N, 4, 4) predicted poses, each in its camera, of a board of the stated size."""
    X = inverse(state.X_AC)[moved.camera] @ moved.X_AH(state.offsets_rad) @ state.X_HM
    X[:, :3, 3] /= state.scale  # a larger board, farther away, looks the same
    return X


def linearise(state: Unknowns, moved: ArmViews, X_CM: Array, model: Model) -> tuple[Array, Array]:
    """Residual twists (N, 6) and their derivative (N, 6, P): a step s makes the residual e - B s."""
    X = predict(state, moved)
    B = np.zeros((len(X), 6, model.size))
    full = X.copy()
    full[:, :3, 3] *= state.scale
    by_camera = -adjoint(inverse(full))
    for c in range(model.cameras):
        B[:, :, 6 * c : 6 * c + 6] = by_camera * (moved.camera == c)[:, None, None]
    poses, n = model.poses, len(model.offsets)
    B[:, :, poses - 6 : poses] = np.eye(6)
    if n:
        B[:, :, poses : poses + n] = joint_spread(state, moved)[:, :, list(model.offsets)]
    if model.scale:
        B[:, 3:, poses + n] = -np.einsum("nji,nj->ni", full[:, :3, :3], full[:, :3, 3])
    B[:, 3:] /= state.scale
    return difference(X, X_CM), B


def joint_spread(state: Unknowns, moved: ArmViews) -> Array:
    """(N, 6, n) G: the board's twist per radian of error of each joint."""
    spread: Array = adjoint(inverse(state.X_HM)) @ moved.body
    return spread


def arm_covariance(state: Unknowns, moved: ArmViews) -> Array:
    """(N, 6, 6) G G^T: covariance of the board's twist by independent errors of 1 rad of the joints."""
    G = joint_spread(state, moved)
    return np.asarray(G @ np.swapaxes(G, 1, 2))


def fit(moved: ArmViews, boards: CondensedViews, start: Unknowns, model: Model) -> Fit:
    """The fit to N views, with the sizes of their errors."""
    state, prior = start, _prior(model)
    plain = model.weights is Weights.PIXELS
    noise = ErrorSizes(1.0, 0.0, 0.0) if plain else ErrorSizes(1.0, _START_PX, _START_RAD)
    for _ in range(1 if plain else _ROUNDS):
        GG = arm_covariance(state, moved)
        state = _gauss_newton(moved, boards.X_CM, boards.covariance(noise, GG), state, model, prior)
        if plain:
            break
        e, B = linearise(state, moved, boards.X_CM, model)
        before, noise = noise, _sizes(e, B, boards, GG, prior, noise)
        if _alike(before, noise):
            break
    e, B = linearise(state, moved, boards.X_CM, model)
    GG = arm_covariance(state, moved)
    covariance = boards.covariance(noise, GG)
    if plain:
        freedom = max(e.size - model.size, 1)
        noise = ErrorSizes(float(np.sqrt(squares(e, covariance).sum() / freedom)), 0.0, 0.0)
        covariance = boards.covariance(noise, GG)
    normal = np.einsum("nip,nir->pr", B, np.linalg.solve(covariance, B)) + prior
    likelihood = -0.5 * float(squares(e, covariance).sum() + np.linalg.slogdet(covariance)[1].sum())
    return Fit(model, state, noise, e, B, covariance, normal, likelihood, moved.posture)


def _prior(model: Model) -> Array:
    n = len(model.offsets)
    return np.diag([0.0] * model.poses + [OFFSET_PRIOR_RAD**-2] * n + [SCALE_PRIOR**-2] * int(model.scale))


def _gauss_newton(
    moved: ArmViews, X_CM: Array, covariance: Array, state: Unknowns, model: Model, prior: Array
) -> Unknowns:
    L = np.linalg.inv(covariance)
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


def _optional(state: Unknowns, model: Model) -> Array:
    """(P,) offsets and scale relative to their priors, zero for the poses."""
    tail = [np.log(state.scale)] if model.scale else []
    return np.concatenate([np.zeros(model.poses), state.offsets_rad[list(model.offsets)], tail])


def _stepped(state: Unknowns, step: Array, model: Model) -> Unknowns:
    offsets = state.offsets_rad.copy()
    poses, n = model.poses, len(model.offsets)
    if n:
        offsets[list(model.offsets)] += np.clip(step[poses : poses + n], -0.05, 0.05)
    scale = state.scale * float(np.exp(np.clip(step[poses + n], -0.1, 0.1))) if model.scale else state.scale
    cameras = move(state.X_AC, step[: poses - 6].reshape(-1, 6))
    return Unknowns(cameras, move(state.X_HM, step[poses - 6 : poses]), offsets, scale)


def squares(e: Array, covariance: Array) -> Array:
    """(N,) squared Mahalanobis lengths of residuals (N, 6)."""
    return np.asarray(np.einsum("ni,ni->n", e, np.linalg.solve(covariance, e[..., None])[..., 0]))


def _sizes(e: Array, B: Array, boards: CondensedViews, GG: Array, prior: Array, noise: ErrorSizes) -> ErrorSizes:
    """Restricted maximum likelihood of `view_px` and `joint_rad`, by Fisher scoring in their logarithms.

    Both have a wide prior, which matters only if the views cannot separate the two.
    """
    own = np.asarray(np.linalg.inv(boards.information))
    terms = np.stack([boards.common, GG])
    x = np.log([noise.view_px, noise.joint_rad])
    for _ in range(_SCORINGS):
        parts = np.exp(2 * x)[:, None, None, None] * terms
        W = np.linalg.inv(own + parts.sum(axis=0))
        WB = W @ B
        A = np.linalg.inv(np.einsum("nip,nir->pr", B, WB) + prior)
        We = np.einsum("nij,nj->ni", W, e)
        WV = W @ parts  # (2, N, 6, 6)
        spent = np.einsum("knij,nji->k", parts, WB @ A @ np.swapaxes(WB, 1, 2))
        slope = np.einsum("ni,knij,nj->k", We, parts, We) - np.einsum("knii->k", WV) + spent
        bend = 2.0 * np.einsum("knij,lnji->kl", WV, WV)
        slope, bend = slope - (x - _EXPECTED) / _WIDTH**2, bend + np.eye(2) / _WIDTH**2
        step = np.clip(np.linalg.solve(bend, slope), -1.5, 1.5)
        x = np.clip(x + step, np.log(_FLOORS), np.log(_CEILINGS))
        if np.abs(step).max() < 0.01:
            break
    return ErrorSizes(1.0, float(np.exp(x[0])), float(np.exp(x[1])))


def _alike(a: ErrorSizes, b: ErrorSizes) -> bool:
    return bool(max(abs(np.log(a.view_px / b.view_px)), abs(np.log(a.joint_rad / b.joint_rad))) < 0.02)
