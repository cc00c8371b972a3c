"""The objects on the table: connected parts of a depth image that rise above it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from hw.types import Array
from perception.arm_mask import Arm
from perception.scan import Raw, Scan

LOW_M, HIGH_M = 0.015, 0.22
"""Heights over the table (m) between which objects are searched. Higher parts hang there, like the arm at home."""
_SMALLEST_M2 = 4e-4  # of the visible face; smaller parts are edges and noise
_KERNEL = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Thing:
    """One connected part."""

    points_m: Array  # (n, 3)
    at_edge: bool  # it reaches the edge of the camera's image

    @property
    def centre_m(self) -> Array:
        """(3,) median of its visible points."""
        return np.asarray(np.median(self.points_m, axis=0))

    @property
    def height_m(self) -> float:
        """Height over the table, without the highest readings, which may be noise."""
        return float(np.percentile(self.points_m[:, 2], 98))

    @property
    def words(self) -> str:
        """Its place and size, for a message."""
        x, y, _ = self.centre_m
        return f"({x:.3f}, {y:+.3f}) m, {1e2 * self.height_m:.0f} cm high"


def things(scan: Scan, raw: Raw, arm: Arm, step: int = 1) -> tuple[Thing, ...]:
    """All objects on the table except the arm, largest first. Only every `step`-th row and column is read."""
    thin = np.s_[::step, ::step]
    depth_m = scan.depth(raw[thin])
    heights = scan.heights(depth_m, thin)
    up = (depth_m > 0) & (heights > LOW_M) & (heights < HIGH_M)
    points = scan.points(depth_m, up, thin)
    kept = ~arm.holds(points)
    mask = np.zeros(up.shape, dtype=np.uint8)
    mask[up] = kept
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _KERNEL)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    of_point = labels[up]  # 0: no object
    rows, columns, camera = scan.view.rows, scan.view.columns, scan.view.camera
    found = []
    for label in range(1, count):
        left, top, w, h, size = (int(x) for x in stats[label])
        chosen = points[of_point == label]
        range_m = float(np.linalg.norm(np.median(chosen, axis=0) - scan.view.X_BV[:3, 3]))
        if size * (step * range_m / scan.view.focal_px) ** 2 < _SMALLEST_M2:
            continue
        first = np.array([columns.start + step * left, rows.start + step * top])
        last = first + step * np.array([w, h])
        at_edge = bool((first <= 2).any() or (last >= np.array([camera.width, camera.height]) - 2).any())
        found.append(Thing(chosen, at_edge))
    return tuple(sorted(found, key=lambda thing: -len(thing.points_m)))
