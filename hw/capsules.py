"""Capsules fixed to the links of the arm, and the distances between them and boxes.

Distances are exact and vectorised over all leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.kinematics import FLANGE
from hw.types import REACH_M, Array, frozen_array, number


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius_m` of a segment that is fixed in a link (0 base, 1..7 links, 8 flange)."""

    name: str
    link: int
    start_m: Array  # (3,) in the link's frame
    end_m: Array  # (3,)
    radius_m: float

    def __post_init__(self) -> None:
        number(self.link, f"link of {self.name}", 0, FLANGE)
        number(self.radius_m, f"radius of {self.name}", 0.0, REACH_M, "m")
        object.__setattr__(self, "start_m", frozen_array(self.start_m, (3,), f"start of {self.name}", most=REACH_M))
        object.__setattr__(self, "end_m", frozen_array(self.end_m, (3,), f"end of {self.name}", most=REACH_M))


def segments(poses: Array, capsules: tuple[Capsule, ...]) -> Array:
    """Link poses (..., 9, 4, 4) -> (..., C, 2, 3): both ends of every capsule's segment in the base frame."""
    links = [c.link for c in capsules]
    ends = np.array([[c.start_m, c.end_m] for c in capsules]).reshape(-1, 2, 3)
    chosen = poses[..., links, :, :]
    return np.asarray(np.einsum("...cij,ckj->...cki", chosen[..., :3, :3], ends) + chosen[..., None, :3, 3])


def segment_distance(a: Array, b: Array) -> Array:
    """Smallest distance between segments (..., 2, 3) and (..., 2, 3) -> (...).

    Closest points as in Ericson, "Real-Time Collision Detection" (2005), 5.1.9.
    """
    d1, d2, r = a[..., 1, :] - a[..., 0, :], b[..., 1, :] - b[..., 0, :], a[..., 0, :] - b[..., 0, :]
    aa, ee, ab = _dot(d1, d1), _dot(d2, d2), _dot(d1, d2)
    ar, br = _dot(d1, r), _dot(d2, r)
    tiny = 1e-18
    det = aa * ee - ab * ab
    s = np.where(det > 1e-12 * (aa * ee + tiny), np.clip((ab * br - ar * ee) / np.maximum(det, tiny), 0.0, 1.0), 0.0)
    t = np.clip((ab * s + br) / np.maximum(ee, tiny), 0.0, 1.0)
    s = np.clip((ab * t - ar) / np.maximum(aa, tiny), 0.0, 1.0)
    gap = r + s[..., None] * d1 - t[..., None] * d2
    return np.sqrt(_dot(gap, gap))


def box_distance(segment: Array, low_m: Array, high_m: Array) -> Array:
    """Smallest distance between segments (..., 2, 3) and a box; 0 where a segment enters it.

    Along a segment, half the derivative of the squared distance is piecewise linear and rises, with breaks at the
    planes of the box. So its zero lies between two of the crossings.
    """
    start, step = segment[..., 0, :], segment[..., 1, :] - segment[..., 0, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.concatenate([(low_m - start) / step, (high_m - start) / step], axis=-1)
    crossing = np.clip(np.where(np.isfinite(crossing), crossing, 0.0), 0.0, 1.0)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*crossing.shape[:-1], 2))
    at = np.sort(np.concatenate([crossing, ends], axis=-1), axis=-1)  # (..., 8)
    point = start[..., None, :] + at[..., None] * step[..., None, :]
    outside = point - np.clip(point, low_m, high_m)
    slope = _dot(outside, np.broadcast_to(step[..., None, :], outside.shape))  # rising along the last axis
    upper = np.clip((slope < 0.0).sum(axis=-1), 1, at.shape[-1] - 1)[..., None]
    t0, t1 = np.take_along_axis(at, upper - 1, -1), np.take_along_axis(at, upper, -1)
    f0, f1 = np.take_along_axis(slope, upper - 1, -1), np.take_along_axis(slope, upper, -1)
    share = np.clip(-f0 / np.where(f1 > f0, f1 - f0, 1.0), 0.0, 1.0)
    closest = start + (t0 + share * (t1 - t0)) * step
    gap = closest - np.clip(closest, low_m, high_m)
    return np.sqrt(_dot(gap, gap))


def travel(poses: Array, capsules: tuple[Capsule, ...]) -> Array:
    """Link poses (N, 9, 4, 4) -> (N - 1, C): the travel of each capsule's ends from one sample to the next."""
    return np.asarray(np.linalg.norm(np.diff(segments(poses, capsules), axis=0), axis=-1).max(axis=-1))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))
