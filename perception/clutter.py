"""The objects on the table: connected parts of a depth image that rise above it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from perception.arm_mask import ArmShape
from perception.geometry import Array32
from perception.scan import Raw, Scan

LOW_M, HIGH_M = 0.015, 0.22
"""Heights over the table (m) between which objects are searched. Higher parts hang there, like the arm at home."""
_SMALLEST_M2 = 4e-4  # of the visible face; smaller parts are edges and noise
_KERNEL = np.ones((3, 3), np.uint8)
_GAP = np.ones((5, 5), np.uint8)
"""Gaps of up to four pixels without readings do not divide an object, because dark, shiny and printed faces have many.
"""
_ONE_FACE_M = 0.012
"""If the depths on the two sides of such a gap differ by more, they belong to two objects."""


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
        """Place and size of the thing, for a message."""
        x, y, _ = self.centre_m
        return f"({x:.3f}, {y:+.3f}) m, {1e2 * self.height_m:.0f} cm high"


def things(scan: Scan, raw: Raw, arm: ArmShape, step: int = 1) -> tuple[Thing, ...]:
    """All objects on the table except the arm, largest first. Only every `step`-th row and column is read."""
    thin = np.s_[::step, ::step]
    depth_m = scan.depth(raw[thin])
    heights = scan.heights(depth_m, thin)
    up = (depth_m > 0) & (heights > LOW_M) & (heights < HIGH_M)
    points = scan.points(depth_m, up, thin)
    free = ~arm.holds(points)
    mask = np.zeros(up.shape, dtype=np.uint8)
    mask[up] = free
    mask |= _between(mask, depth_m)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _KERNEL)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    of_point = labels[up]  # 0: no object
    rows, columns, camera = scan.view.rows, scan.view.columns, scan.view.camera
    groups = []
    for label in range(1, count):
        left, top, w, h, size = (int(x) for x in stats[label])
        chosen = points[of_point == label]
        if not len(chosen):  # nothing but missing readings
            continue
        range_m = float(np.linalg.norm(np.median(chosen, axis=0) - scan.view.X_BV[:3, 3]))
        if size * (step * range_m / scan.view.focal_px) ** 2 < _SMALLEST_M2:
            continue
        first = np.array([columns.start + step * left, rows.start + step * top])
        last = first + step * np.array([w, h])
        at_edge = bool((first <= 2).any() or (last >= np.array([camera.width, camera.height]) - 2).any())
        groups.append(Thing(chosen, at_edge))
    return tuple(sorted(groups, key=lambda thing: -len(thing.points_m)))


def _between(mask: NDArray[np.uint8], depth_m: Array32) -> NDArray[np.uint8]:
    """(h, w) missing readings that lie between readings of one face of `mask`."""
    nearest = cv2.erode(np.where(mask > 0, depth_m, np.float32(np.inf)), _GAP)
    farthest = cv2.dilate(np.where(mask > 0, depth_m, np.float32(0.0)), _GAP)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _GAP)
    return np.asarray(closed * ((depth_m == 0) & (farthest - nearest < _ONE_FACE_M)), dtype=np.uint8)
