"""Bundle adjustment over every corner, with several cameras, several mountings of the target, its size, and the lenses.

The main solution (`calib.solve`) weighs the arm's own noise and works on condensed views of one camera. This one
answers questions that condensed views cannot: Are the stated intrinsics right? Did the target slip, or the camera move?
Where are several cameras that see the same target?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.condense import padded
from calib.geometry import adjoint, move
from calib.projection import LENS, lens_jacobian, project_with_jacobian, with_lens
from hw.poses import inverse
from hw.types import Array, Intrinsics
from perception.board.types import CalibrationTarget, Corners

_ROBUST = 3.0  # residuals beyond this many standard deviations get less weight
_CENTRE_SHARE = 0.05  # prior standard deviation of a principal point, as a share of the image's width
_RECENTRED = 4

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Observations:
    """N pictures of one target."""

    cameras: tuple[Intrinsics, ...]  # C
    camera: Index  # (N,) index of the camera
    mounting: Index  # (N,) index among H mountings of the target in its holder
    X_AH: Array  # (N, 4, 4)
    p_M_m: Array  # (N, K, 3) padded
    px: Array  # (N, K, 2)
    present: NDArray[np.bool_]  # (N, K) False where padded

    def take(self, rows: NDArray[np.bool_] | Index) -> Observations:
        """The chosen pictures."""
        names = ("camera", "mounting", "X_AH", "p_M_m", "px", "present")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


@dataclass(frozen=True, eq=False)
class PixelUnknowns:
    """The unknowns of the adjustment."""

    X_AC: Array  # (C, 4, 4)
    X_HM: Array  # (H, 4, 4)
    scale: float
    lens: Array  # (C, LENS)


@dataclass(frozen=True, eq=False)
class PixelFit:
    """A fit over pixels."""

    place: PixelUnknowns
    noise_px: float  # standard deviation along an axis used as weight
    rms_px: Array  # (N,) distance of the corners, by picture
    J: Array  # (N, 2 K, P) in standard deviations
    residual: Array  # (N, 2 K) in standard deviations
    normal: Array  # (P, P)

    @property
    def px(self) -> float:
        """Root mean square over pictures, px."""
        return float(np.sqrt(np.mean(self.rms_px**2)))


def observations(
    corners: Sequence[Corners], X_AH: Array, target: CalibrationTarget, camera: Intrinsics
) -> Observations:
    """Collect pictures of one camera, one per entry: corners, and pose of the holder (N, 4, 4)."""
    p, px, mask = padded(corners, target)
    none = np.zeros(len(corners), dtype=np.int64)
    return Observations((camera,), none, none, X_AH, p, px, mask > 0)


def poses(place: PixelUnknowns, of: Observations) -> Array:
    """(N, 4, 4) X_CM of the target enlarged by `place.scale`."""
    return np.asarray(inverse(place.X_AC)[of.camera] @ of.X_AH @ place.X_HM[of.mounting])


def rms_px(place: PixelUnknowns, of: Observations) -> Array:
    """(N,) root mean square distance of the corners, by picture."""
    off, _ = _linearised(place, of, lens=False)
    squares = np.sum(off**2, axis=-1) * of.present
    return np.asarray(np.sqrt(squares.sum(axis=1) / of.present.sum(axis=1)))


def adjust(of: Observations, start: PixelUnknowns, noise_px: float, *, scale: bool, lens: bool) -> PixelFit:
    """Least squares with a robust loss from `start`; `scale` and `lens` are free only on request."""
    C, H = len(start.X_AC), len(start.X_HM)
    free = np.ones(6 * C + 6 * H + 1 + LENS * C, dtype=bool)
    free[6 * C + 6 * H] = scale
    free[6 * C + 6 * H + 1 :] = lens
    active = np.flatnonzero(free)
    prior = np.tile([0.0, 1.0, 1.0, 0.0, 0.0], C) / np.repeat([_CENTRE_SHARE * c.width for c in of.cameras], LENS)
    place = start

    def residual(x: Array) -> Array:
        off, _ = _linearised(_stepped(place, x, active), of, lens=False)
        deviation = (_stepped(place, x, active).lens.ravel() * prior) if lens else np.zeros(0)
        return np.concatenate([(off * of.present[..., None]).ravel() / noise_px, deviation])

    def jacobian(x: Array) -> Array:
        _, J = _linearised(_stepped(place, x, active), of, lens=lens)
        J = (J * of.present[..., None, None]).reshape(-1, J.shape[-1])[:, active] / noise_px
        own = np.zeros((LENS * C if lens else 0, len(active)))
        if lens:
            own[:, -LENS * C :] = np.diag(prior)
        return np.concatenate([J, own])

    for _ in range(_RECENTRED):
        step = least_squares(
            residual, np.zeros(len(active)), jacobian, x_scale="jac", loss="soft_l1", f_scale=_ROBUST, max_nfev=30
        )
        place = _stepped(place, step.x, active)
        if np.abs(step.x).max() < 1e-9:
            break
    zero = np.zeros(len(active))
    r, J = residual(zero), jacobian(zero)
    size = of.present.size * 2
    weight = 1 / np.sqrt(1 + (r[:size] / _ROBUST) ** 2)
    normal = np.einsum("rp,r,rq->pq", J[:size], weight, J[:size]) + J[size:].T @ J[size:]
    n = len(of.px)
    return PixelFit(
        place,
        noise_px,
        rms_px(place, of),
        J[:size].reshape(n, -1, len(active)),
        (weight * r[:size]).reshape(n, -1),
        normal,
    )


def jackknife(fit: PixelFit) -> Array:
    """(P, P) covariance by leaving out each picture in turn, with one Newton step from the fit."""
    moved = []
    for J, r in zip(fit.J, fit.residual, strict=True):
        left = fit.normal - J.T @ J
        scale = np.sqrt(np.diagonal(fit.normal)) + 1e-300
        solved = np.linalg.solve(left / np.outer(scale, scale) + 1e-9 * np.eye(len(scale)), (J.T @ r) / scale)
        moved.append(solved / scale)
    steps = np.array(moved) - np.mean(moved, axis=0)
    n = len(moved)
    return np.asarray((n - 1) / n * steps.T @ steps)


def held_out_px(of: Observations, full: PixelFit, folds: int, *, scale: bool, lens: bool) -> Array:
    """(N,) error in px of each picture, predicted by a fit without its fold; N is at least `folds`."""
    order = np.arange(len(of.px)) % folds
    out = np.zeros(len(of.px))
    for fold in range(folds):
        rows = order == fold
        without = adjust(of.take(~rows), full.place, full.noise_px, scale=scale, lens=lens)
        out[rows] = rms_px(without.place, of.take(rows))
    return out


def _stepped(place: PixelUnknowns, x: Array, active: Index) -> PixelUnknowns:
    C, H = len(place.X_AC), len(place.X_HM)
    step = np.zeros(6 * C + 6 * H + 1 + LENS * C)
    step[active] = x
    a, h = step[: 6 * C].reshape(C, 6), step[6 * C : 6 * C + 6 * H].reshape(H, 6)
    lens = step[6 * C + 6 * H + 1 :].reshape(C, LENS)
    scale = place.scale * float(np.exp(np.clip(step[6 * C + 6 * H], -1, 1)))
    return PixelUnknowns(move(place.X_AC, a), move(place.X_HM, h), scale, place.lens + lens)


def _linearised(place: PixelUnknowns, of: Observations, *, lens: bool) -> tuple[Array, Array]:
    """Predicted minus seen (N, K, 2), and its derivative (N, K, 2, all parameters)."""
    C, H = len(place.X_AC), len(place.X_HM)
    N, K = of.px.shape[:2]
    off = np.zeros((N, K, 2))
    J = np.zeros((N, K, 2, 6 * C + 6 * H + 1 + LENS * C))
    X = poses(place, of)
    for c, camera in enumerate(of.cameras):
        rows = np.flatnonzero(of.camera == c)
        if not len(rows):
            continue
        now, p = with_lens(camera, place.lens[c]), place.scale * of.p_M_m[rows]
        uv, J_M = project_with_jacobian(now, X[rows], p)
        off[rows] = uv - of.px[rows]
        J[rows, :, :, 6 * c : 6 * c + 6] = J_M @ -adjoint(inverse(X[rows]))[:, None]
        for h in range(H):
            held = rows[of.mounting[rows] == h]
            J[held, :, :, 6 * C + 6 * h : 6 * C + 6 * h + 6] = J_M[of.mounting[rows] == h]
        J[rows, :, :, 6 * C + 6 * H] = np.einsum("nkai,nki->nka", J_M[..., 3:], p)
        if lens:
            at = 6 * C + 6 * H + 1 + LENS * c
            J[rows, :, :, at : at + LENS] = lens_jacobian(now, X[rows], p)
    return off, J
