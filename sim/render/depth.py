"""The depth image at one instant, with what the sensor model needs to know of the surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from hw.poses import inverse
from hw.types import Array, Intrinsics
from sim.render.bodies import Body, Hits
from sim.render.layers import Latest, Layer
from sim.render.rays import Array32, field_of_view, image_rectangle, pixel_rays
from sim.render.rectangles import Rectangle, is_empty


class DepthView:
    """The depth camera before the still part of the scene."""

    def __init__(self, camera: Intrinsics, X_BD: Array, world: Body) -> None:
        self._camera, self._X_BD = camera, X_BD
        self._rays = pixel_rays(camera)
        self._fov = field_of_view(self._rays)
        shape = self._rays.shape[:2]
        self._z: Array32 = np.full(shape, np.inf, dtype=np.float32)
        self._cosine: Array32 = np.zeros(shape, dtype=np.float32)
        self._albedo: Array32 = np.zeros(shape, dtype=np.float32)
        still = self._layer(world, X_BD, (slice(0, shape[0]), slice(0, shape[1])))
        still.paint(self._z, (self._cosine, self._albedo))
        self._layers: Latest[Layer | None] = Latest()

    def render(self, moving: Sequence[tuple[Body, Array]]) -> tuple[Array32, Array32, Array32]:
        """Depth (inf where nothing is), cosine of incidence and grey albedo, each (H, W); poses are (4, 4)."""
        z, cosine, albedo = self._z.copy(), self._cosine.copy(), self._albedo.copy()
        for body, X_BO in moving:
            layer = self._layers.get(body, X_BO, partial(self._seen, body, X_BO))
            if layer is not None:
                layer.paint(z, (cosine, albedo))
        return z, cosine, albedo

    def _seen(self, body: Body, X_BO: Array) -> Layer | None:
        """A body at a pose (4, 4); None where it is out of view."""
        X_DO = inverse(self._X_BD) @ X_BO
        corners = body.corners_m @ X_DO[:3, :3].T + X_DO[:3, 3]
        box = image_rectangle(corners, self._camera, self._fov)
        return None if is_empty(box) else self._layer(body, inverse(X_DO), box)

    def _layer(self, body: Body, X_OD: Array, box: Rectangle) -> Layer:
        hits = body.cast(X_OD, self._rays[box].reshape(-1, 3))
        return Layer.within(box, hits.index, hits.t, _cosine(hits), hits.albedo.mean(axis=1))


def _cosine(hits: Hits) -> Array32:
    length = np.linalg.norm(hits.along, axis=1)
    return np.asarray(np.abs(np.einsum("ni,ni->n", hits.normal, hits.along)) / length, dtype=np.float32)
