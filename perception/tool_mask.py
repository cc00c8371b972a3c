"""Where the tool hides the object, from its mesh and its kinematic pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array
from perception.geometry import Array32, ImageRegion


class ToolMask:
    """The tool's mesh, ready for ray casting. Single-threaded: it uses one core."""

    def __init__(self, vertices_m: Array, triangles: NDArray[np.integer]) -> None:
        """`vertices_m` (V, 3) in the tool frame T, `triangles` (F, 3)."""
        import open3d as o3d  # noqa: PLC0415 - slow to import, and the first question comes without it

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
