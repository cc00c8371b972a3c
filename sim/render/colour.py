"""The colour image: samples spread over exposure and pixel, averaged in linear light."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, Intrinsics
from sim.render import shading
from sim.render.bodies import Body
from sim.render.layers import Latest, Layer
from sim.render.rays import Array32, field_of_view, image_rectangle, pixel_rays, shift_rays
from sim.render.rectangles import Rectangle, coarser, is_empty, union, within

JITTER_PX = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))
"""Where in its pixel each of the samples looks: time and space are sampled together, edges come out smooth."""
SAMPLES = len(JITTER_PX)
_SHADOW_STRIDE = 2

Moving = Sequence[tuple[Body, Array]]
"""Bodies with their poses (samples, 4, 4) in the base frame."""


@dataclass(frozen=True, eq=False)
class _Canvas:
    """One sample of (a part of) the image; parts share memory with the whole."""

    t: Array32  # (h, w) depth, inf where nothing is
    rgb: NDArray[np.floating]  # (h, w, 3) linear
    lit: NDArray[np.bool_]  # (h, w) turned towards the key light

    def part(self, box: Rectangle) -> Self:
        return type(self)(self.t[box], self.rgb[box], self.lit[box])

    def fresh(self) -> _Canvas:
        return _Canvas(self.t.copy(), self.rgb.astype(np.float32), self.lit.copy())


class ColourView:
    """The colour camera before the still part of the scene."""

    def __init__(self, camera: Intrinsics, X_BC: Array, world: Body) -> None:
        self._camera, self._X_BC, self._X_CB = camera, X_BC, inverse(X_BC)
        centre_rays = pixel_rays(camera)
        self._fov = field_of_view(centre_rays)
        self._rays = [shift_rays(centre_rays, du, dv) for du, dv in JITTER_PX]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            self._still = list(pool.map(partial(self._still_sample, world), self._rays))
        mean: Array32 = np.mean([sample.rgb.astype(np.float32) for sample in self._still], axis=0, dtype=np.float32)
        self._still_srgb = shading.srgb(mean)
        self._boxes: Latest[tuple[Rectangle, Rectangle]] = Latest()
        self._layers: Latest[Layer] = Latest()

    def render(self, moving: Moving) -> NDArray[np.uint8]:
        """(H, W, 3) RGB of bodies at `SAMPLES` poses each."""
        image = self._still_srgb.copy()
        boxes = [self._boxes.get(body, X, partial(self._covered, body, X)) for body, X in moving]
        seen, shaded = [box for box, _ in boxes], [box for _, box in boxes]
        region = union([*seen, *shaded])
        if region is None:
            return image
        total: Array32 = np.zeros((*image[region].shape[:2], 3), dtype=np.float32)
        shadow = total[..., 0]
        for k, (still, rays) in enumerate(zip(self._still, self._rays, strict=True)):
            canvas = still.part(region).fresh()
            corner = region[0].start, region[1].start
            for (body, X), box in zip(moving, seen, strict=True):
                if not is_empty(box):
                    layer = self._layers.get((body, k), X[k], partial(self._layer, body, X[k], box, rays))
                    layer.paint(canvas.t, (canvas.rgb, canvas.lit), corner)
            total += canvas.rgb
            if k == SAMPLES // 2:
                shadow = self._shadow([(body, X[k]) for body, X in moving], shaded, region, canvas, rays[region])
        total *= (1 - np.float32(shading.SHADOW_SHARE) * shadow[..., None]) / SAMPLES
        image[region] = shading.srgb(total)
        return image

    def _still_sample(self, world: Body, rays: Array32) -> _Canvas:
        flat, shape = rays.reshape(-1, 3), rays.shape[:2]
        hits = world.cast(self._X_BC, flat)
        points = self._X_BC[:3, 3].astype(np.float32) + hits.along * hits.t[:, None]
        radiance = shading.lambert(hits.albedo, hits.normal)
        top = np.abs(points[:, 2]) < 2e-3
        radiance[top] *= shading.grain(points[top])
        t, lit = np.full(len(flat), np.inf, dtype=np.float32), np.zeros(len(flat), dtype=np.bool_)
        rgb = np.tile(shading.BACKGROUND_RGB.astype(np.float16), (len(flat), 1))
        t[hits.index], rgb[hits.index], lit[hits.index] = hits.t, radiance, shading.lit_by_key(hits.normal)
        return _Canvas(t.reshape(shape), rgb.reshape(*shape, 3), lit.reshape(shape))

    def _covered(self, body: Body, X_BO: Array) -> tuple[Rectangle, Rectangle]:
        """Where a body at poses (samples, 4, 4) can be seen, and where it or its shadow can."""
        corners = self._corners(body, X_BO)
        return self._rectangle(corners), self._rectangle(_with_feet(corners))

    def _layer(self, body: Body, X_BO: Array, box: Rectangle, rays: Array32) -> Layer:
        """A body at a pose (4, 4), which can only be seen within `box`; `rays` are those of the whole image."""
        hits = body.cast(inverse(X_BO) @ self._X_BC, rays[box].reshape(-1, 3))
        normal = hits.normal @ X_BO[:3, :3].T.astype(np.float32)
        return Layer.within(box, hits.index, hits.t, shading.lambert(hits.albedo, normal), shading.lit_by_key(normal))

    def _shadow(
        self,
        moving: Moving,
        boxes: Sequence[Rectangle],
        region: Rectangle,
        canvas: _Canvas,
        rays: Array32,
    ) -> Array32:
        """(h, w) of `region`: how much of the key light the moving bodies, at poses (4, 4), take away; 0 to 1."""
        step = _SHADOW_STRIDE
        t, lit, rays = canvas.t[::step, ::step], canvas.lit[::step, ::step], rays[::step, ::step]
        dark: Array32 = np.zeros(t.shape, dtype=np.float32)
        for (body, X_BO), box in zip(moving, boxes, strict=True):
            if is_empty(box):
                continue
            part = coarser(within(box, region), step)
            asked = lit[part] & np.isfinite(t[part]) & (dark[part] < 1)
            X_OB = inverse(X_BO)
            points = self._points(rays[part][asked], t[part][asked])
            local: Array32 = points @ X_OB[:3, :3].T.astype(np.float32) + X_OB[:3, 3].astype(np.float32)
            dark[part][asked] = body.occludes(local, X_OB[:3, :3] @ shading.KEY_LIGHT)
        height, width = canvas.t.shape
        return np.asarray(cv2.resize(cv2.blur(dark, (3, 3)), (width, height)), dtype=np.float32)

    def _points(self, rays: Array32, t: Array32) -> Array32:
        """(n, 3) in the base frame."""
        points: Array32 = (rays * t[:, None]) @ self._X_BC[:3, :3].T.astype(np.float32)
        points += self._X_BC[:3, 3].astype(np.float32)
        return points

    @staticmethod
    def _corners(body: Body, X_BO: Array) -> Array:
        return (body.corners_m @ np.swapaxes(X_BO[:, :3, :3], 1, 2) + X_BO[:, None, :3, 3]).reshape(-1, 3)

    def _rectangle(self, points_B_m: Array) -> Rectangle:
        return image_rectangle(points_B_m @ self._X_CB[:3, :3].T + self._X_CB[:3, 3], self._camera, self._fov)


def _with_feet(corners_m: Array) -> Array:
    """Corners of a body and of its shadow on the table: all that it can darken lies between them."""
    height = np.maximum(corners_m[:, 2:], 0)
    return np.concatenate([corners_m, corners_m - height * (shading.KEY_LIGHT / shading.KEY_LIGHT[2])])
