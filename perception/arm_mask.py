"""Which points of a depth image belong to the arm, and where the tool hides the object, by their own kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, frozen_array
from perception.geometry import Array32, ImageRegion
from perception.raycasting import load_open3d
from perception.scan import Mask


class ToolMask:
    """The tool's mesh, ready for ray casting. Single-threaded: it uses one core."""

    def __init__(self, vertices_m: Array, triangles: NDArray[np.integer]) -> None:
        """`vertices_m` (V, 3) in the tool frame T, `triangles` (F, 3)."""
        o3d = load_open3d()
        self._tensor = o3d.core.Tensor.from_numpy
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._low_m, self._high_m = vertices_m.min(axis=0), vertices_m.max(axis=0)
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(vertices_m, dtype=np.float32)),
            self._tensor(np.ascontiguousarray(triangles, dtype=np.uint32)),
        )

    def depth(self, X_BT: Array, view: ImageRegion, directions: Array32) -> Array32:
        """Depth (n,) of the tool along rays (n, 3) with z = 1 of `view`; inf for a miss."""
        X_TV = inverse(X_BT) @ view.X_BV
        rays = np.empty((len(directions), 6), dtype=np.float32)
        rays[:, :3] = X_TV[:3, 3]
        rays[:, 3:] = directions @ X_TV[:3, :3].T.astype(np.float32)
        depth: Array32 = self._scene.cast_rays(self._tensor(rays), nthreads=1)["t_hit"].numpy()
        return depth

    def near(self, X_BT: Array, points_B_m: Array, within_m: float) -> NDArray[np.bool_]:
        """(n,) whether points (n, 3) of the base frame lie within `within_m` of the tool's surface."""
        points_T = ((points_B_m - X_BT[:3, 3]) @ X_BT[:3, :3]).astype(np.float32)
        close = ((points_T > self._low_m - within_m) & (points_T < self._high_m + within_m)).all(axis=1)
        if close.any():
            candidates = self._tensor(np.ascontiguousarray(points_T[close]))
            close[close] = self._scene.compute_distance(candidates, nthreads=1).numpy() < within_m
        return np.asarray(close)


_ARM_SLACK_M = 0.025  # the outline contains the arm; cables and the wide pixels at its edges lie outside
_TOOL_SLACK_M = 0.009  # the tool's mesh is exact; this covers the camera's error


@dataclass(frozen=True, eq=False)
class Capsules:
    """All points within `radii_m` of segments."""

    ends_m: Array  # (C, 2, 3) in the base frame
    radii_m: Array  # (C,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "ends_m", frozen_array(self.ends_m, (None, 2, 3), "ends of the capsules"))
        object.__setattr__(self, "radii_m", frozen_array(self.radii_m, (len(self.ends_m),), "radii of the capsules"))

    def hold(self, points_m: Array, slack_m: float) -> Mask:
        """(n,) whether points (n, 3) lie in a capsule, or within `slack_m` of one."""
        held = np.zeros(len(points_m), dtype=bool)
        for (start, end), radius_m in zip(self.ends_m, self.radii_m, strict=True):
            reach = radius_m + slack_m
            low, high = np.minimum(start, end) - reach, np.maximum(start, end) + reach
            near = np.flatnonzero(~held & ((points_m > low) & (points_m < high)).all(axis=1))
            axis, arm = end - start, points_m[near] - start
            along = np.clip(arm @ axis / max(float(axis @ axis), 1e-18), 0.0, 1.0)
            gap = arm - along[:, None] * axis
            held[near] = np.einsum("ni,ni->n", gap, gap) < reach**2
        return held


NOTHING = Capsules(np.zeros((0, 2, 3)), np.zeros(0))
"""The capsules of an arm outside the picture: none."""


@dataclass(frozen=True, eq=False)
class ArmShape:
    """Arm and tool at one moment."""

    capsules: Capsules = NOTHING
    tool: ToolMask | None = None
    X_BT: Array | None = None

    def holds(self, points_m: Array) -> Mask:
        """(n,) whether points (n, 3) of the base frame are arm or tool."""
        held = self.capsules.hold(points_m, _ARM_SLACK_M)
        if self.tool is not None and self.X_BT is not None and len(points_m):
            rest = np.flatnonzero(~held)
            if len(rest):
                held[rest] = self.tool.near(self.X_BT, points_m[rest], _TOOL_SLACK_M)
        return held


NO_ARM = ArmShape()
"""An arm outside the picture, or too high to matter."""
