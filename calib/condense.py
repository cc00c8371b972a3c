"""Condenses each view to the information of its corners about the board's pose in the camera.

Near its minimum, the reprojection error of a view is a constant plus a quadratic form in the six numbers of the board's
pose. Minimum, place and form are computed once from all corners. Every later fit (dozens: starts, rejections, model
comparisons, held-out fits) then works on six numbers per view. The result differs from a bundle adjustment over all
pixels by less than a hundredth of its own error (tested).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.bundle import CondensedViews
from calib.errors import TooFewViews, determined
from calib.geometry import move
from calib.projection import project, project_with_jacobian
from hw.types import Array, Intrinsics
from perception.board.detection import in_a_row, starts
from perception.board.types import CalibrationTarget, Corners

_HUBER = 2.5  # in standard deviations of a corner
_NOISE_FLOOR_PX = 0.02
_FAR_RAD = 1.5
_FLAT = 1e-6
_OUTSIDE = 1.0  # corners that another program extrapolates may lie half a picture beyond its edge
_ROUGH = 2.0
"""A view with corner errors this many times the usual ones counts with its own noise (a bent print, a lens)."""


@dataclass(frozen=True, eq=False)
class PoseCandidates:
    """The board in N views, with two candidate poses per view, because a flat board has a mirror solution."""

    camera: Intrinsics
    p_M_m: Array  # (N, K, 3) points, padded with the first one
    px: Array  # (N, K, 2)
    weight: Array  # (N, K) 0 where padded, 1 or less
    X_CM: Array  # (2, N, 4, 4) best poses; the first fits better
    information: Array  # (2, N, 6, 6) inverse covariance of the twist in the board's axes
    common: Array  # (2, N, 6, 6) covariance of that twist by smooth errors of 1 px, common to the corners of a view
    rms_px: Array  # (2, N) distances of corners in that pose; inf: no second pose
    corner_px: float  # standard deviation of a corner along an axis, in most views
    own_px: Array  # (N,) the same for each view; larger if its own corners are worse

    def candidate(self, side: int) -> CondensedViews:
        """All views in their better (0) or mirror pose (1)."""
        return CondensedViews(self.X_CM[side], self.information[side], self.common[side])

    def rms_at(self, X_CM: Array) -> Array:
        """(N,) root mean square distance of the corners for boards at `X_CM` (N, 4, 4)."""
        squares = np.sum((project(self.camera, X_CM, self.p_M_m) - self.px) ** 2, axis=-1)
        present = self.weight > 0
        return np.asarray(np.sqrt(np.sum(squares * present, axis=1) / present.sum(axis=1)))


def unusable(corners: Corners, target: CalibrationTarget, camera: Intrinsics) -> str:
    """Why a view with these corners cannot be condensed; "" if it can."""
    if len(corners) and corners.ids[-1] >= target.corners:
        return (
            f"corner {corners.ids[-1]}, but a {target.name} has corners 0 to {target.corners - 1}: state the right "
            "target"
        )
    points = target.p_MK_m[corners.ids]
    centre, reach = np.array([camera.width, camera.height]) / 2, _OUTSIDE * max(camera.width, camera.height)
    if len(corners) and np.abs(corners.px - centre).max() > reach:
        return f"corners lie far outside the picture of {camera.width} x {camera.height}: state them in its pixels"
    if len(corners) < target.least or in_a_row(points, target.spacing_m):
        return f"{len(corners)} corners, fewer than {target.least} or all in one row"
    if not starts(points, corners.px, camera):
        return f"no pose of the {target.name} explains its corners: wrong target or intrinsics"
    return ""


@determined()
def condense(
    names: Sequence[str], corners: Sequence[Corners], board: CalibrationTarget, camera: Intrinsics
) -> PoseCandidates:
    """Fit every view by itself. Raises TooFewViews naming an unusable view."""
    if not corners:
        raise TooFewViews("there are no views: record some")
    for name, view_corners in zip(names, corners, strict=True):
        if why := unusable(view_corners, board, camera):
            raise TooFewViews(f"view {name}: {why}: leave the view out")
    p, px, mask = padded(corners, board)
    start = np.stack([_both(starts(p[i, : len(c)], c.px, camera)) for i, c in enumerate(corners)], axis=1)
    twin = np.repeat(p, 2, axis=0).reshape(len(p), 2, *p.shape[1:]).swapaxes(0, 1)
    X = start.copy()
    weight = np.broadcast_to(mask, (2, *mask.shape)).copy()
    noise = 1.0
    for sweep in range(3):  # first plain, then with lower weights for outlying corners
        for side in range(2):
            X[side] = _polish(X[side], twin[side], px, weight[side], camera)
        off = np.stack([np.linalg.norm(project(camera, X[s], p) - px, axis=-1) for s in range(2)])
        noise = _corner_noise(off[0], weight[0] > 0)
        if sweep < 2:
            weight = mask * np.minimum(1.0, _HUBER * np.sqrt(2.0) * noise / np.maximum(off, 1e-9))
    rms = np.sqrt(np.sum(off**2 * mask, axis=-1) / mask.sum(axis=-1))
    X, weight, rms = _best_first(X, weight, rms)
    own = np.maximum(noise, _own_noise(rms[0], mask) / _ROUGH)
    J = np.stack([project_with_jacobian(camera, X[s], p)[1] for s in range(2)])
    A = np.einsum("snkai,snk,snkaj->snij", J, weight, J)
    common = np.stack([_common(J[s], weight[s], A[s], px, mask) for s in range(2)])
    return PoseCandidates(camera, p, px, weight[0], X, A / own[:, None, None] ** 2, common, rms, noise, own)


def about(sight: PoseCandidates, X_CM: Array, noise_px: float | None = None) -> CondensedViews:
    """The same views, condensed about the predicted poses (N, 4, 4) of a fit.

    With `noise_px`, every corner of every view counts with this standard deviation, and an outlying corner counts less.

    A small target seen nearly head-on has no well-defined best pose of its own, and the error around it is not a
    parabola. Around the prediction it is nearly one, so that alternating fits and condensations reach the optimum over
    all pixels.
    """
    uv, J = project_with_jacobian(sight.camera, X_CM, sight.p_M_m)
    off = np.linalg.norm(uv - sight.px, axis=-1)
    own_px = sight.own_px if noise_px is None else np.full(len(off), noise_px)
    usual = np.maximum(own_px, np.median(off, axis=1)) if noise_px is None else own_px
    limit = _HUBER * np.sqrt(2.0) * usual[:, None]
    weight = (sight.weight > 0) * np.minimum(1.0, limit / np.maximum(off, 1e-9))
    A = np.einsum("nkai,nk,nkaj->nij", J, weight, J)
    A += 1e-9 * np.einsum("nii->n", A)[:, None, None] * np.eye(6)
    b = np.einsum("nkai,nk,nka->ni", J, weight, sight.px - uv)
    step = np.linalg.solve(A, b[..., None])[..., 0]
    too_far = np.maximum(1.0, np.linalg.norm(step[:, :3], axis=1) / _FAR_RAD)
    common = _common(J, weight, A, sight.px, (sight.weight > 0).astype(np.float64))
    return CondensedViews(move(X_CM, step / too_far[:, None]), A / own_px[:, None, None] ** 2, common)


def _common(J: Array, weight: Array, A: Array, px: Array, mask: Array) -> Array:
    """(N, 6, 6) covariance of the fitted twist by smooth errors of the corners of 1 px along an axis.

    Smooth errors are constant, linear and quadratic in the place in the picture; each term has the same share.
    """
    present, count = mask[..., None], mask.sum(axis=1)[:, None, None]
    xy = (px - np.sum(px * present, axis=1, keepdims=True) / count) * present
    x, y = np.moveaxis(xy / np.abs(xy).max(axis=(1, 2), keepdims=True), -1, 0)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1) * present
    terms[..., 3:] -= present * np.sum(terms[..., 3:], axis=1, keepdims=True) / count
    size = np.sqrt(np.sum(terms**2, axis=1, keepdims=True) / count)
    terms = np.where(size > _FLAT, terms / np.maximum(size, _FLAT), 0.0) / np.sqrt(terms.shape[-1])
    pulls = np.einsum("nkai,nkt->nati", J, weight[..., None] * terms)
    twists = np.linalg.solve(A[:, None, None], pulls[..., None])[..., 0]
    return np.asarray(np.einsum("nati,natj->nij", twists, twists))


def padded(corners: Sequence[Corners], board: CalibrationTarget) -> tuple[Array, Array, Array]:
    """Points (N, K, 3) m, pixels (N, K, 2), and 1 where they are not padding (N, K)."""
    most = max(len(c) for c in corners)
    p, px, mask = (np.zeros((len(corners), most, *tail)) for tail in ((3,), (2,), ()))
    for i, c in enumerate(corners):
        n = len(c)
        p[i, :n], px[i, :n], mask[i, :n] = board.p_MK_m[c.ids], c.px, 1.0
        p[i, n:], px[i, n:] = p[i, 0], px[i, 0]
    return p, px, mask


def _both(poses: Sequence[Array]) -> Array:
    """(2, 4, 4) both poses of a flat board; the same pose twice if there is only one."""
    return np.stack([poses[0], poses[-1]])


def _polish(X: Array, p: Array, px: Array, weight: Array, camera: Intrinsics) -> Array:
    """Gauss-Newton with a little damping, all views together."""
    for _ in range(8):
        uv, J = project_with_jacobian(camera, X, p)
        A = np.einsum("nkai,nk,nkaj->nij", J, weight, J)
        b = np.einsum("nkai,nk,nka->ni", J, weight, px - uv)
        A += 1e-9 * np.einsum("nii->n", A)[:, None, None] * np.eye(6)
        step = np.linalg.solve(A, b[..., None])[..., 0]
        X = move(X, np.clip(step, -0.2, 0.2))
        if np.abs(step).max() < 1e-10:
            break
    return X


def _corner_noise(off: Array, mask: NDArray[np.bool_]) -> float:
    """Standard deviation along an axis, from the median view, so that a few spoilt views do not matter."""
    n = mask.sum(axis=1)
    middle = np.array([np.median(row[mask_row]) for row, mask_row in zip(off, mask, strict=True)])
    # the median of a Rayleigh variable is 1.1774 sigma; six parameters were fitted to 2 n numbers
    return max(float(np.median(middle / 1.1774 / np.sqrt(1 - 6 / (2 * n)))), _NOISE_FLOOR_PX)


def _own_noise(rms: Array, mask: NDArray[np.bool_] | Array) -> Array:
    """(N,) standard deviation along an axis by each view's own best fit."""
    n = mask.sum(axis=1)
    return np.asarray(rms / np.sqrt(2.0) / np.sqrt(1 - 6 / (2 * n)))


def _best_first(X: Array, weight: Array, rms: Array) -> tuple[Array, Array, Array]:
    swap = rms[1] < rms[0]
    same = np.abs(X[0] - X[1]).max(axis=(1, 2)) < 1e-4
    X[:, swap], weight[:, swap], rms[:, swap] = X[::-1][:, swap], weight[::-1][:, swap], rms[::-1][:, swap]
    rms[1, same] = np.inf
    return X, weight, rms
