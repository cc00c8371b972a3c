"""The place of the proxy in one frame: its outline and depth are compared with the picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hw.poses import pose
from hw.types import Array
from perception.geometry import Array32, ImageRegion, transform
from perception.piece.proxy import Proxy, coverage

_OUTLINE_NOISE = 0.25  # of a pixel's share; also covers the difference between proxy and piece
_DEPTH_FLOOR_M, _DEPTH_NOISE_M = 0.0008, 0.0025  # systematic error of the mean over the piece, and noise of one pixel
_DEPTH_GATE_M = 0.010
_TABLE_SLACK_M = 0.001
_NOTICED = 0.3  # a pixel shows the piece from this share on
_STEPS = 8
_LONGEST_STEP_M = 0.012


@dataclass(frozen=True, eq=False)
class Evidence:
    """The readings of both cameras around one place, and the tool there."""

    view: ImageRegion  # colour
    share: Array32  # (n,) of each pixel that the piece covers
    tool_m: Array32  # (n,) depth of the tool, inf where it is not
    depth_view: ImageRegion
    depth_rays: Array32  # (m, 3) with z = 1, of readings that belong to the piece by colour
    depth_m: Array  # (m,) these readings, corrected

    @cached_property
    def xy(self) -> Array32:
        """(n, 2) ideal pixels."""
        return self.view.xy.reshape(-1, 2)

    @cached_property
    def noticed(self) -> float:
        """Visible area of the piece in the window, in pixels."""
        return float(self.share[self.share > _NOTICED].sum())


@dataclass(frozen=True, eq=False)
class PieceFix:
    """An estimate for one frame."""

    centre_m: Array  # (3,) in the base frame
    visible: float  # share of the outline not hidden by the tool
    fit: float  # 0 ... 1, agreement of the free part with the picture

    @property
    def confidence(self) -> float:
        """Share of the piece that is seen and explained."""
        return self.visible * self.fit


def appraise(evidence: Evidence, proxy: Proxy, R_BO: Array, centre_m: Array) -> PieceFix:
    """How well the proxy at `centre_m` agrees with the evidence."""
    X_BO = pose(R_BO, centre_m)
    near, cover, _ = coverage(proxy.outline(X_BO, evidence.view), evidence.xy)
    expected = cover * _free(evidence, proxy, X_BO, near)
    share = evidence.share[near]
    inside = (cover > 0) | (share > _NOTICED)
    stray = evidence.noticed - float(share[share > _NOTICED].sum())
    miss = stray + float(np.abs(share - expected)[inside].sum())
    whole = stray + float(np.maximum(share, expected)[inside].sum())
    visible = float(expected.sum()) / max(float(cover.sum()), 1.0)
    return PieceFix(centre_m, visible, float(np.clip(1 - miss / max(whole, 1.0), 0, 1)))


def locate(evidence: Evidence, proxy: Proxy, R_BO: Array, start_m: Array, prior_std_m: float) -> PieceFix:
    """Gauss-Newton from `start_m` (3,), which is also a prior with standard deviation `prior_std_m`.

    The outline fixes the place across the line of sight, the mean depth of the visible front fixes it along the line.
    Hidden parts contribute nothing.
    """
    lowest_m = min(proxy.half_m) - _TABLE_SLACK_M
    centre = start_m.copy()
    for _ in range(_STEPS):
        X_BO = pose(R_BO, centre)
        near, cover, change = coverage(proxy.outline(X_BO, evidence.view), evidence.xy)
        free = _free(evidence, proxy, X_BO, near)
        J = (free[:, None] * change) @ _image_motion(evidence.view, centre) / _OUTLINE_NOISE
        r = (evidence.share[near] - cover * free) / _OUTLINE_NOISE
        A = J.T @ J + np.eye(3) / prior_std_m**2
        b = J.T @ r + (start_m - centre) / prior_std_m**2
        off_m, slope, sigma_m = _depth_residual(evidence, proxy, X_BO)
        A += np.outer(slope, slope) / sigma_m**2
        b += slope * off_m / sigma_m**2
        if centre[2] < lowest_m:
            A[2, 2] += 1 / _TABLE_SLACK_M**2
            b[2] += (lowest_m - centre[2]) / _TABLE_SLACK_M**2
        step = np.linalg.solve(A, b)
        length = float(np.linalg.norm(step))
        centre = centre + step * min(1.0, _LONGEST_STEP_M / max(length, 1e-12))
        if length < 5e-5:
            break
    return appraise(evidence, proxy, R_BO, centre)


def _free(evidence: Evidence, proxy: Proxy, X_BO: Array, pixels: NDArray[np.intp]) -> Array:
    """(k,) for these pixels: 0 where the tool hides the piece, else 1."""
    free = np.ones(len(pixels))
    tool_m = evidence.tool_m[pixels]
    tool = np.flatnonzero(np.isfinite(tool_m))
    if len(tool):
        front = proxy.depth(X_BO, evidence.view, evidence.view.directions[pixels[tool]], inflate=1.15)
        free[tool[np.isfinite(front) & (tool_m[tool] < front)]] = 0.0
    return free


def _image_motion(view: ImageRegion, centre_m: Array) -> Array:
    """(2, 3) how a point's ideal pixel moves with its place in the base frame."""
    x, y, z = transform(view.X_VB, centre_m)
    J: Array = view.focal_px / z * np.array([[1, 0, -x / z], [0, 1, -y / z]]) @ view.X_VB[:3, :3]
    return J


def _depth_residual(evidence: Evidence, proxy: Proxy, X_BO: Array) -> tuple[float, Array, float]:
    """Mean of measured minus expected depth over the visible front, its slope (3,) in the centre, its sigma."""
    front, normal = proxy.front(X_BO, evidence.depth_view, evidence.depth_rays)
    along = evidence.depth_rays @ evidence.depth_view.X_BV[:3, :3].T
    facing = np.einsum("mi,mi->m", normal, along)
    use = np.isfinite(front) & (facing < -0.3 * np.linalg.norm(along, axis=1))
    if use.sum() < 4:
        return 0.0, np.zeros(3), 1.0
    off, slopes = evidence.depth_m[use] - front[use], normal[use] / facing[use, None]
    weight = np.maximum(1 - ((off - np.median(off)) / _DEPTH_GATE_M) ** 2, 0) ** 2
    count = weight.sum()
    if count < 1.0:  # two surfaces, equally seen: their middle is neither
        return 0.0, np.zeros(3), 1.0
    sigma = float(np.hypot(_DEPTH_FLOOR_M, _DEPTH_NOISE_M / np.sqrt(count)))
    return float(weight @ off / count), weight @ slopes / count, sigma
