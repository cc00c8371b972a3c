"""Renders the colour image: samples over exposure and pixel, averaged in linear light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, Intrinsics
from sim.render import shading
from sim.render.bodies import Body, Latest, Layer
from sim.render.rays import (
    Array32,
    Pixels,
    Rectangle,
    coarser,
    field_of_view,
    holds_still,
    image_rectangle,
    outline,
    pixel_rays,
    shift_rays,
    through,
    union,
    within,
)

JITTER_PX = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))
"""Offset of each sample within its pixel. The samples differ in time and place, for smooth edges."""
SAMPLES = len(JITTER_PX)
_SHADOWED = SAMPLES // 2
"""Shadows are computed for this sample alone, at every `_STRIDE`-th pixel."""
_STRIDE = 2
_BAND = 90
"""Rows of the static scene that are cast at once, because casting a ray takes ten times the memory of its colour."""

Posed = Sequence[tuple[Body, Array]]
"""Bodies with their poses (samples, 4, 4) in the base frame."""


@dataclass(frozen=True, eq=False)
class _Scene:
    """All samples of the image, or of a rectangle of it, with some of the bodies painted."""

    t: tuple[Array32, ...]  # (h, w) depth of each sample, inf where nothing is
    rgb: tuple[Array32, ...]  # (h, w, 3) linear
    lit: NDArray[np.bool_]  # (h, w) facing the key light, in the sample for shadows
    dark: Array32  # of the whole image, every `_STRIDE`-th pixel: the key light is taken away, 0 or 1

    def copy(self, box: Rectangle) -> _Scene:
        """The part inside `box`, to be painted on."""
        t, rgb = tuple(t[box].copy() for t in self.t), tuple(rgb[box].copy() for rgb in self.rgb)
        return _Scene(t, rgb, self.lit[box].copy(), self.dark.copy())

    def picture(self, box: Rectangle) -> NDArray[np.uint8]:
        """(h, w, 3) sRGB of this scene, which covers `box` of the image."""
        total: Array32 = self.rgb[0] + self.rgb[1]
        for rgb in self.rgb[2:]:
            total += rgb
        size = _STRIDE * self.dark.shape[1], _STRIDE * self.dark.shape[0]
        shadow = cv2.resize(cv2.blur(self.dark, (3, 3)), size)[box]
        total *= (1 - np.float32(shading.SHADOW_SHARE) * shadow[..., None]) / SAMPLES
        return shading.srgb(total)


class ColourView:
    """The colour camera and the static part of the scene.

    Bodies that hold still during an exposure are painted first. That picture is kept until the set of bodies at rest,
    or one of their poses, changes.
    """

    def __init__(self, camera: Intrinsics, X_BC: Array, world: Body) -> None:
        self._camera, self._X_BC, self._X_CB = camera, X_BC, inverse(X_BC)
        centre_rays = pixel_rays(camera)
        self._fov = field_of_view(centre_rays)
        self._rays = [shift_rays(centre_rays, du, dv) for du, dv in JITTER_PX]
        t, rgb, lit = zip(*(self._still_sample(world, rays) for rays in self._rays), strict=True)
        dark = np.zeros((-(-camera.height // _STRIDE), -(-camera.width // _STRIDE)), dtype=np.float32)
        self._bare = _Scene(t, rgb, lit[_SHADOWED], dark)
        self._outlines: Latest[Pixels] = Latest()
        self._layers: Latest[Layer] = Latest()
        self._at_rest: Latest[tuple[_Scene, NDArray[np.uint8]]] = Latest()
        self._one_paints = Lock()

    def render(self, bodies: Posed) -> NDArray[np.uint8]:
        """(H, W, 3) RGB of bodies at `SAMPLES` poses each."""
        resting = [(body, X) for body, X in bodies if holds_still(X)]
        moving = [(body, X) for body, X in bodies if not holds_still(X)]
        key = tuple((body, X[0].tobytes()) for body, X in resting)
        with self._one_paints:
            backdrop, image = self._at_rest.get("backdrop", key, partial(self._backdrop, resting))
        region = self._touched(moving)
        if region is None:
            return image
        image = image.copy()
        image[region] = self._painted(backdrop, resting, moving, region).picture(region)
        return image

    def _backdrop(self, resting: Posed) -> tuple[_Scene, NDArray[np.uint8]]:
        everything = slice(0, self._camera.height), slice(0, self._camera.width)
        scene = self._painted(self._bare, (), resting, everything)
        return scene, scene.picture(everything)

    def _painted(self, base: _Scene, bodies: Posed, coming: Posed, region: Rectangle) -> _Scene:
        """`base`, which already shows `bodies`, cut to `region`, with the bodies `coming` painted on it."""
        scene = base.copy(region)
        corner = region[0].start, region[1].start
        for k in range(SAMPLES):
            for body, X in coming:
                layer = self._layers.get((body, k), X.tobytes(), partial(self._layer, body, X, k))
                pictures = (scene.rgb[k], scene.lit) if k == _SHADOWED else (scene.rgb[k],)
                layer.paint(scene.t[k], pictures, corner)
        some = slice(None, None, _STRIDE)
        lit = scene.lit[some, some] & np.isfinite(scene.t[_SHADOWED][some, some])
        changed = (scene.t[_SHADOWED] != base.t[_SHADOWED][region])[some, some]
        scene.dark[coarser(region, _STRIDE)][changed] = 0
        self._darken(scene, region, coming, lit)
        self._darken(scene, region, bodies, lit & changed)
        return scene

    def _still_sample(self, world: Body, rays: Array32) -> tuple[Array32, Array32, NDArray[np.bool_]]:
        """Depth (H, W), linear colour (H, W, 3), and the mask (H, W) of surfaces that face the key light."""
        parts = [self._still_band(world, rays[top : top + _BAND]) for top in range(0, len(rays), _BAND)]
        t, rgb, lit = (np.concatenate(pictures) for pictures in zip(*parts, strict=True))
        return t, rgb, lit

    def _still_band(self, world: Body, rays: Array32) -> tuple[Array32, Array32, NDArray[np.bool_]]:
        flat, shape = rays.reshape(-1, 3), rays.shape[:2]
        hits = world.cast(self._X_BC, flat)
        points = self._points(flat[hits.index], hits.t)
        normal = world.normals(self._X_BC[:3, 3])
        radiance = hits.albedo * shading.light(normal)[hits.triangle]
        top = np.abs(points[:, 2]) < 2e-3
        radiance[top] *= shading.grain(points[top])
        t, lit = np.full(len(flat), np.inf, dtype=np.float32), np.zeros(len(flat), dtype=np.bool_)
        rgb = np.tile(shading.BACKGROUND_RGB, (len(flat), 1))
        t[hits.index], rgb[hits.index] = hits.t, radiance
        lit[hits.index] = shading.lit_by_key(normal)[hits.triangle]
        return t.reshape(shape), rgb.reshape(*shape, 3), lit.reshape(shape)

    def _layer(self, body: Body, X_BO: Array, k: int) -> Layer:
        """A body at poses (samples, 4, 4), in sample k."""
        pixels = self._outlines.get(body, X_BO.tobytes(), partial(self._outline, body, X_BO))
        X_OC = inverse(X_BO[k]) @ self._X_BC
        hits = body.cast(X_OC, through(pixels, self._rays[k]))
        normal = body.normals(X_OC[:3, 3]) @ X_BO[k, :3, :3].T.astype(np.float32)
        values: tuple[NDArray[np.generic], ...] = (hits.albedo * shading.light(normal).take(hits.triangle, axis=0),)
        if k == _SHADOWED:
            values = (*values, shading.lit_by_key(normal).take(hits.triangle))
        return Layer(pixels[0].take(hits.index), pixels[1].take(hits.index), hits.t, values)

    def _outline(self, body: Body, X_BO: Array) -> Pixels:
        """The pixels that a body at poses (samples, 4, 4) can cover during the exposure."""
        X_CO = self._X_CB @ X_BO[: 1 if holds_still(X_BO) else None : SAMPLES - 1]  # first and last
        points_m = body.points_m @ np.swapaxes(X_CO[:, :3, :3], 1, 2) + X_CO[:, None, :3, 3]
        return outline(points_m, body.parts, self._camera, self._fov)

    def _touched(self, moving: Posed) -> Rectangle | None:
        """The rectangle that bodies at poses (samples, 4, 4) and their shadows can change.

        It begins at multiples of `_STRIDE`.
        """
        around = union([self._shaded(body, X) for body, X in moving])
        if around is None:
            return None
        rows, columns = (slice(side.start // _STRIDE * _STRIDE, side.stop) for side in around)
        return rows, columns

    def _shaded(self, body: Body, X_BO: Array) -> Rectangle:
        """The rectangle that a body at poses (samples, 4, 4) and its shadow can cover."""
        corners = (body.corners_m @ np.swapaxes(X_BO[:, :3, :3], 1, 2) + X_BO[:, None, :3, 3]).reshape(-1, 3)
        points = _with_feet(corners) @ self._X_CB[:3, :3].T + self._X_CB[:3, 3]
        return image_rectangle(points, self._camera, self._fov)

    def _darken(self, scene: _Scene, region: Rectangle, bodies: Posed, lit: NDArray[np.bool_]) -> None:
        """Mark, in a scene of `region`, the lit points that bodies at poses (samples, 4, 4) put in shadow."""
        some = slice(None, None, _STRIDE)
        t, rays = scene.t[_SHADOWED][some, some], self._rays[_SHADOWED][region][some, some]
        dark = scene.dark[coarser(region, _STRIDE)]
        for body, X in bodies:
            part = coarser(within(self._shaded(body, X), region), _STRIDE)
            candidates = lit[part] & (dark[part] < 1)
            X_OB = inverse(X[_SHADOWED])
            points = self._points(rays[part][candidates], t[part][candidates])
            local: Array32 = points @ X_OB[:3, :3].T.astype(np.float32) + X_OB[:3, 3].astype(np.float32)
            dark[part][candidates] = body.occludes(local, X_OB[:3, :3] @ shading.KEY_LIGHT)

    def _points(self, rays: Array32, t: Array32) -> Array32:
        """(n, 3) in the base frame."""
        points: Array32 = (rays * t[:, None]) @ self._X_BC[:3, :3].T.astype(np.float32)
        points += self._X_BC[:3, 3].astype(np.float32)
        return points


def _with_feet(corners_m: Array) -> Array:
    """Corners of a body and of its shadow on the table. Everything that the body can darken lies between them."""
    height = np.maximum(corners_m[:, 2:], 0)
    return np.concatenate([corners_m, corners_m - height * (shading.KEY_LIGHT / shading.KEY_LIGHT[2])])
