"""Renders the depth image at one instant, with the surface properties for the sensor model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from hw.poses import inverse
from hw.types import Array, Intrinsics
from sim.render.bodies import Body, Hits, Latest, Layer
from sim.render.outlines import Outline, outline
from sim.render.rays import Array32, field_of_view, pixel_rays


class DepthView:
    """The depth camera and the static part of the scene."""

    def __init__(self, camera: Intrinsics, X_BD: Array, world: Body) -> None:
        self._camera, self._X_BD = camera, X_BD
        self._rays = pixel_rays(camera)
        self._fov = field_of_view(self._rays)
        rows, columns = np.divmod(np.arange(self._rays[..., 0].size), camera.width)
        shape = self._rays.shape[:2]
        self._z: Array32 = np.full(shape, np.inf, dtype=np.float32)
        self._cosine: Array32 = np.zeros(shape, dtype=np.float32)
        self._albedo: Array32 = np.zeros(shape, dtype=np.float32)
        self._layer(world, X_BD, Outline(rows, columns)).paint(self._z, (self._cosine, self._albedo))
        self._layers: Latest[Layer] = Latest()

    def render(self, moving: Sequence[tuple[Body, Array]]) -> tuple[Array32, Array32, Array32]:
        """Depth (inf: no hit), cosine of incidence and grey albedo, each (H, W); poses are (4, 4)."""
        z, cosine, albedo = self._z.copy(), self._cosine.copy(), self._albedo.copy()
        for body, X_BO in moving:
            layer = self._layers.get(body, X_BO.tobytes(), partial(self._seen, body, X_BO))
            layer.paint(z, (cosine, albedo))
        return z, cosine, albedo

    def _seen(self, body: Body, X_BO: Array) -> Layer:
        """A body at a pose (4, 4)."""
        X_DO = inverse(self._X_BD) @ X_BO
        points_m = body.points_m @ X_DO[:3, :3].T + X_DO[:3, 3]
        return self._layer(body, inverse(X_DO), outline(points_m[None], body.parts, self._camera, self._fov))

    def _layer(self, body: Body, X_OD: Array, seen: Outline) -> Layer:
        along = self._rays[seen.rows, seen.columns]
        hits = body.cast(X_OD, along)
        cosine = cosines(hits, body, X_OD, along)
        return Layer(seen.rows[hits.index], seen.columns[hits.index], hits.t, (cosine, hits.albedo.mean(axis=1)))


def cosines(hits: Hits, body: Body, X_OD: Array, along: Array32) -> Array32:
    """(m,) cosines of the angles between the rays `along` (n, 3), in a frame D, and the normals of the triangles they
    hit.
    """
    normal = (body.normals(X_OD[:3, 3]) @ X_OD[:3, :3].astype(np.float32))[hits.triangle]
    hit = along[hits.index]
    return np.asarray(np.abs(np.einsum("ni,ni->n", normal, hit)) / np.linalg.norm(hit, axis=1), dtype=np.float32)
