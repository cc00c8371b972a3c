"""One ray-casting scene per body: rays are transformed into the body's frame, so no scene is ever rebuilt."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from perception.raycasting import load_open3d
from sim.render.rays import Array32
from sim.render.shading import paint
from sim.types import Visual, merged


@dataclass(frozen=True, eq=False)
class Hits:
    """The hits of m rays of a bundle."""

    index: NDArray[np.intp]  # (m,) indices of the rays, rising
    t: Array32  # (m,) along the rays: depth in metres where directions have z = 1
    triangle: NDArray[np.intp]  # (m,) of the body
    albedo: Array32  # (m, 3) linear RGB


class Body:
    """The visuals of one frame, ready for ray casting."""

    def __init__(self, visuals: Sequence[Visual]) -> None:
        """`visuals` all belong to one body and have at least one triangle."""
        o3d = load_open3d()
        self._tensor = o3d.core.Tensor.from_numpy
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)  # pictures are rendered in parallel
        vertices, triangles = merged([(v.vertices_m, v.triangles) for v in visuals])
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(vertices, dtype=np.float32)),
            self._tensor(np.ascontiguousarray(triangles, dtype=np.uint32)),
        )
        counts = [len(visual.triangles) for visual in visuals]
        self._albedo = np.repeat(np.array([v.rgb for v in visuals], dtype=np.float32), counts, axis=0)
        first = np.cumsum([0, *counts])
        self._textures = [(first[i], first[i + 1], v.texture) for i, v in enumerate(visuals) if v.texture is not None]
        a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
        self._on_m, self._normal = a, _unit(np.cross(b - a, c - a))  # a point and the normal of each triangle
        parts = _connected(len(vertices), triangles)
        ends = np.cumsum([0, *map(len, parts)])
        self.points_m: Array = vertices[np.concatenate(parts)]  # (N, 3) of the surface, in the body's frame
        self.parts = tuple(slice(a, b) for a, b in pairwise(ends))  # the connected pieces
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
        self.corners_m: Array = corners.astype(np.float64)  # (8, 3) of the bounding box, in the body's frame

    def normals(self, p_m: Array) -> Array32:
        """(T, 3) unit normals of the triangles, on the side of a point `p_m` (3,) in the body's frame."""
        towards = np.einsum("ni,ni->n", self._normal, p_m - self._on_m)
        return np.asarray(np.where(towards < 0, -1.0, 1.0)[:, None] * self._normal, dtype=np.float32)

    def cast(self, X_body_ray: Array, directions: Array32) -> Hits:
        """Hits of rays from the origin of a frame along `directions` (n, 3) in it."""
        rays = _rays(X_body_ray, directions)
        answer = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        t_hit = answer["t_hit"].numpy()
        index = np.flatnonzero(np.isfinite(t_hit))
        t, triangle = t_hit.take(index), answer["primitive_ids"].numpy().take(index).astype(np.intp)
        albedo = self._albedo.take(triangle, axis=0)
        for first, last, texture in self._textures:
            on_it = (triangle >= first) & (triangle < last)
            points = X_body_ray[:3, 3] + rays[index[on_it], 3:].astype(np.float64) * t[on_it, None]
            albedo[on_it] = paint(texture, points, albedo[on_it])
        return Hits(index, t, triangle, albedo)

    def occludes(self, points_m: Array32, direction: Array) -> NDArray[np.bool_]:
        """(n,) whether the body lies between `points_m` (n, 3) and a light far away along `direction` (3,)."""
        rays = np.empty((len(points_m), 6), dtype=np.float32)
        rays[:, :3] = points_m
        rays[:, 3:] = direction
        answer = self._scene.test_occlusions(self._tensor(rays), tnear=2e-4, nthreads=1)
        blocked: NDArray[np.bool_] = answer.numpy()
        return blocked


def _rays(X_body_ray: Array, directions: Array32) -> Array32:
    """(n, 6) origins and directions in the body's frame."""
    rays = np.empty((len(directions), 6), dtype=np.float32)
    rays[:, :3] = X_body_ray[:3, 3]
    rays[:, 3:] = directions @ X_body_ray[:3, :3].T.astype(np.float32)
    return rays


def _unit(normals: Array) -> Array:
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))


def _connected(count: int, triangles: NDArray[np.int32]) -> list[NDArray[np.intp]]:
    """The vertices of each connected piece of a mesh with triangles (T, 3)."""
    label = np.arange(count)
    while True:
        before = label.copy()
        for corner in range(3):
            np.minimum.at(label, triangles[:, corner], label[triangles].min(axis=1))
        if np.array_equal(label, before):
            return [np.flatnonzero(label == one) for one in np.unique(label)]


Known = TypeVar("Known")


@dataclass(frozen=True, eq=False)
class Layer:
    """The pixels that show a body, with their values."""

    rows: NDArray[np.intp]  # (m,) in the whole image
    columns: NDArray[np.intp]  # (m,)
    t: Array32  # (m,) depth
    values: tuple[NDArray[Any], ...]  # (m, ...) each, one per picture

    def paint(self, t: Array32, pictures: Sequence[NDArray[Any]], corner: tuple[int, int] = (0, 0)) -> None:
        """Where the layer is nearer than `t` (h, w), replace `t` and the values of `pictures` (h, w, ...).

        Each picture is contiguous in memory; `corner` is the row and column of the image at which it begins.
        """
        flat = t.reshape(-1)
        at = (self.rows - corner[0]) * t.shape[1] + self.columns - corner[1]
        nearer = np.flatnonzero(self.t < flat.take(at))
        at = at.take(nearer)
        flat[at] = self.t.take(nearer)
        for picture, value in zip(pictures, self.values, strict=True):
            picture.reshape(-1, *picture.shape[2:])[at] = value.take(nearer, axis=0)


class Latest(Generic[Known]):
    """Caches the last result per key, so that bodies at rest are not rendered again."""

    def __init__(self) -> None:
        self._known: dict[Hashable, tuple[Hashable, Known]] = {}

    def get(self, what: Hashable, key: Hashable, make: Callable[[], Known]) -> Known:
        """The last result for `what` if it had the same `key`; otherwise the result of `make`, which is kept.

        `key` holds everything that the result depends on.
        """
        entry = self._known.get(what)
        if entry is None or entry[0] != key:
            entry = key, make()
            self._known[what] = entry
        return entry[1]
