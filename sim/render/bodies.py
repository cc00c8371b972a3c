"""One ray-casting scene per body: rays are moved into the body's frame, so nothing is ever rebuilt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from hw.types import Array
from sim.render.rays import Array32
from sim.render.textures import paint
from sim.types import Visual


@dataclass(frozen=True, eq=False)
class Hits:
    """What those m of a bundle of rays met that met anything."""

    index: NDArray[np.intp]  # (m,) which rays, rising
    t: Array32  # (m,) along the rays: depth in metres where directions have z = 1
    along: Array32  # (m, 3) the rays, in the body's frame
    normal: Array32  # (m, 3) unit, in the body's frame, towards the ray's origin
    albedo: Array32  # (m, 3) linear RGB


class Body:
    """The visuals that share one frame, ready for rays."""

    def __init__(self, visuals: Sequence[Visual]) -> None:
        """`visuals` all belong to one body; at least one triangle in all."""
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)  # pictures are rendered side by side
        albedo: list[Array32] = []
        for visual in visuals:
            self._scene.add_triangles(
                o3d.core.Tensor.from_numpy(np.ascontiguousarray(visual.vertices_m, dtype=np.float32)),
                o3d.core.Tensor.from_numpy(np.ascontiguousarray(visual.triangles, dtype=np.uint32)),
            )
            albedo.append(np.asarray(visual.rgb, dtype=np.float32))
        self._albedo = np.stack(albedo)
        self._textures = {i: v.texture for i, v in enumerate(visuals) if v.texture is not None}
        points = np.concatenate([visual.vertices_m for visual in visuals])
        low, high = points.min(axis=0), points.max(axis=0)
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
        self.corners_m: Array = corners.astype(np.float64)  # (8, 3) of the bounding box, in the body's frame

    def cast(self, X_body_ray: Array, directions: Array32) -> Hits:
        """Hits of rays from the origin of a frame along `directions` (n, 3) in it."""
        rays = _rays(X_body_ray, directions)
        answer = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
        t_hit = answer["t_hit"].numpy()
        index = np.flatnonzero(np.isfinite(t_hit))
        t, geometry = t_hit[index], answer["geometry_ids"].numpy()[index]
        normal = answer["primitive_normals"].numpy()[index]
        along = rays[index, 3:]
        normal *= np.where(np.einsum("ni,ni->n", normal, along) > 0, np.float32(-1), np.float32(1))[:, None]
        albedo = self._albedo[geometry]
        for number, texture in self._textures.items():
            on_it = geometry == number
            points = X_body_ray[:3, 3] + along[on_it].astype(np.float64) * t[on_it, None]
            albedo[on_it] = paint(texture, points, albedo[on_it])
        return Hits(index, t, along, normal, albedo)

    def occludes(self, points_m: Array32, direction: Array) -> NDArray[np.bool_]:
        """(n,) whether the body lies between `points_m` (n, 3) and a light far away along `direction` (3,)."""
        rays = np.empty((len(points_m), 6), dtype=np.float32)
        rays[:, :3] = points_m
        rays[:, 3:] = direction
        blocked: NDArray[np.bool_] = self._scene.test_occlusions(o3d.core.Tensor.from_numpy(rays), tnear=2e-4).numpy()
        return blocked


def _rays(X_body_ray: Array, directions: Array32) -> Array32:
    """(n, 6) origins and directions in the body's frame."""
    rays = np.empty((len(directions), 6), dtype=np.float32)
    rays[:, :3] = X_body_ray[:3, 3]
    rays[:, 3:] = directions @ X_body_ray[:3, :3].T.astype(np.float32)
    return rays
