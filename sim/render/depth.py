"""The depth image at one instant, with what the sensor model needs to know of the surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.poses import inverse
from hw.types import Array, Intrinsics
from sim.render.bodies import Body
from sim.render.rays import Array32, field_of_view, image_rectangle, pixel_rays
from sim.render.rectangles import is_empty


class DepthView:
    """The depth camera before the still part of the scene."""

    def __init__(self, camera: Intrinsics, X_BD: Array, world: Body) -> None:
        self._camera, self._X_BD = camera, X_BD
        self._rays = pixel_rays(camera)
        self._fov = field_of_view(self._rays)
        shape, flat = self._rays.shape[:2], self._rays.reshape(-1, 3)
        hits = world.cast(X_BD, flat)
        self._z = hits.t.reshape(shape)
        self._cosine = _cosine(hits.normal, flat @ X_BD[:3, :3].T.astype(np.float32)).reshape(shape)
        self._albedo: Array32 = hits.albedo.mean(axis=1).reshape(shape)

    def render(self, moving: Sequence[tuple[Body, Array]]) -> tuple[Array32, Array32, Array32]:
        """Depth (inf where nothing is), cosine of incidence and grey albedo, each (H, W); poses are (4, 4)."""
        z, cosine, albedo = self._z.copy(), self._cosine.copy(), self._albedo.copy()
        for body, X_BO in moving:
            X_DO = inverse(self._X_BD) @ X_BO
            corners = body.corners_m @ X_DO[:3, :3].T + X_DO[:3, 3]
            box = image_rectangle(corners, self._camera, self._fov)
            if is_empty(box):
                continue
            rays, X_OD = self._rays[box].reshape(-1, 3), inverse(X_DO)
            hits = body.cast(X_OD, rays)
            nearer = hits.t < z[box].reshape(-1)
            mask = nearer.reshape(z[box].shape)
            z[box][mask] = hits.t[nearer]
            cosine[box][mask] = _cosine(hits.normal[nearer], rays[nearer] @ X_OD[:3, :3].T.astype(np.float32))
            albedo[box][mask] = hits.albedo[nearer].mean(axis=1)
        return z, cosine, albedo


def _cosine(normal: Array32, along: Array32) -> Array32:
    length = np.linalg.norm(along, axis=1)
    return np.asarray(np.abs(np.einsum("ni,ni->n", normal, along)) / length, dtype=np.float32)
