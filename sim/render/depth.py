"""Renders the pictures of the depth camera at one instant: depth, with the surface properties for the sensor model, and
infrared, for which the camera lights the scene itself and measures the returned light.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from hw.poses import inverse
from hw.types import Array, Intrinsics
from sim.render.bodies import Body, Hits, Latest, Layer
from sim.render.colour import JITTER_PX
from sim.render.rays import (
    Array32,
    Pixels,
    field_of_view,
    image_rectangle,
    is_empty,
    outline,
    pixel_rays,
    shift_rays,
    through,
)


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
        self._layer(world, X_BD, (rows, columns)).paint(self._z, (self._cosine, self._albedo))
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

    def _layer(self, body: Body, X_OD: Array, pixels: Pixels) -> Layer:
        along = through(pixels, self._rays)
        hits = body.cast(X_OD, along)
        cosine = cosines(hits, body, X_OD, along)
        return Layer(pixels[0].take(hits.index), pixels[1].take(hits.index), hits.t, (cosine, hits.albedo.mean(axis=1)))


def cosines(hits: Hits, body: Body, X_OD: Array, along: Array32) -> Array32:
    """(m,) cosines of the angles between the rays `along` (n, 3), in a frame D, and the normals of the triangles they
    hit.
    """
    normal = (body.normals(X_OD[:3, 3]) @ X_OD[:3, :3].astype(np.float32)).take(hits.triangle, axis=0)
    hit = along.take(hits.index, axis=0)
    return np.asarray(np.abs(np.einsum("ni,ni->n", normal, hit)) / np.linalg.norm(hit, axis=1), dtype=np.float32)


class InfraredView:
    """The depth camera's own picture of bodies and the static part of the scene, at one instant."""

    def __init__(self, camera: Intrinsics, X_BD: Array, world: Body) -> None:
        self._camera, self._X_BD = camera, X_BD
        centre_rays = pixel_rays(camera)
        self._fov = field_of_view(centre_rays)
        self._rays = [shift_rays(centre_rays, du, dv) for du, dv in JITTER_PX]
        self._still = [self._cast(world, X_BD, rays) for rays in self._rays]

    def render(self, moving: Sequence[tuple[Body, Array]]) -> Array32:
        """(H, W) returned light, 1 for a white surface facing the camera at 1 m; poses (4, 4) in the base frame."""
        total: Array32 = np.zeros((self._camera.height, self._camera.width), dtype=np.float32)
        boxes = [self._rectangle(body, X_BO) for body, X_BO in moving]
        for rays, (still_z, still_light) in zip(self._rays, self._still, strict=True):
            z, light = still_z.copy(), still_light.copy()
            for (body, X_BO), box in zip(moving, boxes, strict=True):
                if is_empty(box):
                    continue
                near_z, near_light = self._cast(body, inverse(X_BO) @ self._X_BD, rays[box])
                nearer = near_z < z[box]
                z[box][nearer] = near_z[nearer]
                light[box][nearer] = near_light[nearer]
            total += light
        return total / np.float32(len(self._rays))

    @staticmethod
    def _cast(body: Body, X_OD: Array, rays: Array32) -> tuple[Array32, Array32]:
        flat = rays.reshape(-1, 3)
        hits = body.cast(X_OD, flat)
        t, light = np.full(len(flat), np.inf, dtype=np.float32), np.zeros(len(flat), dtype=np.float32)
        distance = hits.t * np.linalg.norm(flat[hits.index], axis=1)
        t[hits.index] = hits.t
        light[hits.index] = hits.albedo.mean(axis=1) * cosines(hits, body, X_OD, flat) / distance**2
        return t.reshape(rays.shape[:2]), light.reshape(rays.shape[:2])

    def _rectangle(self, body: Body, X_BO: Array) -> tuple[slice, slice]:
        X_DO = inverse(self._X_BD) @ X_BO
        corners = body.corners_m @ X_DO[:3, :3].T + X_DO[:3, 3]
        return image_rectangle(corners, self._camera, self._fov)
