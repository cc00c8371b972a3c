"""The possible error of a fit.

The covariance of least squares trusts its own noise model; with corner noise alone it is up to ten times too small. The
jackknife uses the views themselves: leave out each in turn and measure how far the result moves. It is unbiased but
rough with twenty views. So the two are averaged (our noise model includes the arm, see `bundle`). Both miss errors
common to all views. These are covered by a floor, and by a rotation about the first joint, which no view can show.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.stats import t as student

from calib.bundle import ArmViews, Fit
from calib.geometry import adjoint, cross_matrix
from calib.types import JointOffsets, Setup, Uncertainty, ViewInfluence
from hw.types import Array

FACTOR_PLAIN = 0.92
FACTOR_OFFSETS = 1.15
FACTOR_TURN = 1.1
"""Factors on the standard deviations that make the 95 % bounds hold: without estimated joint offsets, with them, and
for the unobservable rotation. Fitted on seeds 10000 to 10089 of `tests/support/simulated_views.py`, tested on others.
"""

FLOOR_MM, FLOOR_DEG = 0.01, 0.0005
"""Floor: one standard deviation per direction. No calibration is better than its intrinsics, print and bracket."""

_DRAWS = 2000


def jackknife(fit: Fit) -> Array:
    """(P, P) covariance of all parameters by leaving out each posture in turn, with one Newton step from the fit."""
    LB = np.linalg.solve(fit.covariance, fit.B)
    postures, which = np.unique(fit.posture, return_inverse=True)
    together = np.zeros((len(postures), fit.B.shape[2]))
    np.add.at(together, which, np.einsum("nip,ni->np", LB, fit.residual))
    A_i = np.zeros((len(postures), *fit.normal.shape))
    np.add.at(A_i, which, np.einsum("nip,nir->npr", fit.B, LB))
    scale = np.sqrt(np.diagonal(fit.normal))
    left = (fit.normal - A_i) / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    moved = -np.linalg.solve(left, (together / scale)[..., None])[..., 0] / scale
    moved -= moved.mean(axis=0)
    n = len(moved)
    covariance: Array = (n - 1) / n * moved.T @ moved
    return covariance


def uncertainty(fit: Fit, moved: ArmViews, setup: Setup, joints: JointOffsets | None, camera: int = 0) -> Uncertainty:
    """The uncertainty of one camera of the final fit; `joints` are the estimated joint offsets, adopted or not."""
    offsets = bool(fit.model.offsets)
    n, p = 6 * len(fit.residual), fit.model.size
    factor = FACTOR_OFFSETS if offsets else FACTOR_PLAIN
    own = slice(6 * camera, 6 * camera + 6)
    inside = factor**2 * 0.5 * (jackknife(fit) + np.linalg.inv(fit.normal))[own, own]
    if setup.lens_covariance is not None:
        inside = inside + setup.lens_covariance
    X_AC = fit.state.X_AC[camera]
    R = X_AC[:3, :3]
    axes = np.kron(np.eye(2), R)
    covariance = axes @ inside @ axes.T + np.diag([np.deg2rad(FLOOR_DEG) ** 2] * 3 + [(1e-3 * FLOOR_MM) ** 2] * 3)
    turn_rad = FACTOR_TURN * base_turn_rad(joints)
    in_arm = _draws(n - p) @ np.linalg.cholesky(covariance).T
    freedom = len(fit.model.offsets) or moved.joints - 2
    hidden = _turn_twist(X_AC, moved)
    absolute = in_arm + (turn_rad * _turns(max(freedom, 1)))[:, None] * hidden
    total = covariance + turn_rad**2 * np.outer(hidden, hidden)
    lever = setup.p_AP_m - X_AC[:3, 3]
    figures = [_figures(draws, lever) for draws in (absolute, in_arm)]
    return Uncertainty(
        sigma_mm=float(1e3 * np.sqrt(np.trace(total[3:, 3:]))),
        sigma_deg=float(np.rad2deg(np.sqrt(np.trace(total[:3, :3])))),
        position_95_mm=figures[0][0],
        rotation_95_deg=figures[0][1],
        work_95_mm=figures[0][2],
        worst_95_mm=figures[0][3],
        arm_work_95_mm=figures[1][2],
        arm_worst_95_mm=figures[1][3],
        base_turn_deg=float(np.rad2deg(turn_rad)),
        covariance=covariance,
    )


def base_turn_rad(joints: JointOffsets | None) -> float:
    """One standard deviation of the unobservable offset: the size of the observable ones, minus their noise.

    Offsets that were estimated but not adopted may still be real, so they count too.
    """
    if joints is None or not np.isfinite(joints.delta_bic):
        return 0.0
    suspected, noise = (values[np.isfinite(joints.sigma_rad)] for values in (joints.suspected_rad, joints.sigma_rad))
    return float(np.sqrt(max(float(np.mean(suspected**2 - noise**2)), 0.0)))


def _turn_twist(X_AC: Array, moved: ArmViews) -> Array:
    """(6,) effect of one radian of the hidden offset on the camera: rotation, and shift of its origin, in axes of A."""
    if not moved.joints:
        return np.zeros(6)
    hidden = 0 if moved.mounting.value == "fixed" else moved.joints - 1
    twist = (adjoint(moved.X_AH(np.zeros(moved.joints))[:1]) @ moved.body[:1])[0, :, hidden]
    return np.concatenate([twist[:3], twist[3:] + np.cross(twist[:3], X_AC[:3, 3])])


@cache
def _draws(freedom: int) -> Array:
    """(D, 6) standard normal, widened as Student's t: the noise was estimated too."""
    rng = np.random.default_rng(1908)
    normal = rng.standard_normal((_DRAWS, 6))
    heavy: Array = normal * np.sqrt(max(freedom, 3) / rng.chisquare(max(freedom, 3), (_DRAWS, 1)))
    return heavy


@cache
def _turns(freedom: int) -> Array:
    """(D,) Student's t at evenly spaced levels, shuffled."""
    levels = (np.arange(_DRAWS) + 0.5) / _DRAWS
    shuffled: Array = np.random.default_rng(1909).permutation(student.ppf(levels, freedom))
    return shuffled


def _figures(draws: Array, lever: Array) -> tuple[float, float, Array, float]:
    """95 % levels of the shift mm, the rotation deg, the shift at each point mm, and at the worst point mm."""
    shift = draws[:, None, 3:] - (cross_matrix(lever) @ draws[:, :3].T).transpose(2, 0, 1)  # w x l = -[l] w
    at_points = 1e3 * np.linalg.norm(shift, axis=-1)
    position = 1e3 * np.linalg.norm(draws[:, 3:], axis=1)
    rotation = np.rad2deg(np.linalg.norm(draws[:, :3], axis=1))
    level = 95.0
    return (
        float(np.percentile(position, level)),
        float(np.percentile(rotation, level)),
        np.percentile(at_points, level, axis=0),
        float(np.percentile(at_points.max(axis=1), level)),
    )


MORE = 3
_MOST = 12


def view_influence(fit: Fit, names: Sequence[str], lever_m: Array) -> ViewInfluence:
    """The value of the views, called `names`, for a fit to one camera.

    `lever_m` (P, 3) are the work points relative to the camera, in axes of its carrier.

    If a series cannot be solved without some view, that view counts as infinitely helpful.
    """
    information = np.einsum("nip,nij,njq->npq", fit.B, np.linalg.inv(fit.covariance), fit.B)
    R = np.kron(np.eye(2), fit.state.X_AC[0, :3, :3])

    def error(normal: Array) -> float:
        scale = np.sqrt(np.maximum(np.diagonal(normal), 1e-30))
        try:
            inside = np.linalg.inv(normal / np.outer(scale, scale))[:6, :6] / np.outer(scale[:6], scale[:6])
        except np.linalg.LinAlgError:
            return float("inf")
        covariance = R @ inside @ R.T
        jacobian = np.concatenate([-cross_matrix(lever_m), np.broadcast_to(np.eye(3), (len(lever_m), 3, 3))], axis=-1)
        spread = np.einsum("pij,jk,pik->p", jacobian, covariance, jacobian)
        return float(np.sqrt(spread.max())) if (np.diagonal(covariance) > 0.0).all() else float("inf")

    now = error(fit.normal)
    without = [(name, error(fit.normal - view) / now - 1.0) for name, view in zip(names, information, strict=True)]
    without.sort(key=lambda pair: (-pair[1], pair[0]))
    normal, chosen, shares = fit.normal.copy(), list[int](), list[float]()
    for _ in range(_MOST):
        errors = [error(normal + view) for view in information]
        best = int(np.argmin(errors))
        normal = normal + information[best]
        chosen.append(best)
        shares.append(errors[best] / now)
    halved = [count for count, share in enumerate(shares, start=1) if share <= 0.5]
    more = tuple(dict.fromkeys(names[i] for i in chosen[:MORE]))
    return ViewInfluence(tuple(without), more, shares[MORE - 1], halved[0] if halved else None)
