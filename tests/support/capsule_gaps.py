"""How far points lie outside of capsules, by code of its own."""

from __future__ import annotations

import numpy as np

from hw.capsules import Capsule
from hw.types import Array


def outside_m(points_m: Array, capsules: tuple[Capsule, ...]) -> Array:
    """(P,) how far points (P, 3) lie outside of all capsules of their link."""
    gaps = []
    for capsule in capsules:
        axis = capsule.end_m - capsule.start_m
        along = np.clip((points_m - capsule.start_m) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        gaps.append(np.linalg.norm(points_m - capsule.start_m - along[:, None] * axis, axis=1) - capsule.radius_m)
    return np.asarray(np.min(gaps, axis=0))
