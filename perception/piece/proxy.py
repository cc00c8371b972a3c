"""The stand-in for the piece: an ellipsoid, a cylinder or a box of known size, its outline and its front."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array
from perception.geometry import Array32, ImageRegion, transform


class Shape(StrEnum):
    """The shape that the piece resembles most."""

    ELLIPSOID = "ellipsoid"
    CYLINDER = "cylinder"
    BOX = "box"


_ANGLES = np.linspace(0, 2 * np.pi, 36, endpoint=False)
_SAME_AREA = np.sqrt(np.pi / (18 * np.sin(np.pi / 18)))  # a polygon of 36 corners with the area of the circle
_RING = _SAME_AREA * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
_RIMS = np.concatenate([np.c_[_RING, np.full(36, z)] for z in (-1.0, 1.0)])
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


@dataclass(frozen=True)
class Proxy:
    """A convex body, symmetric about its centre; its axes are X, Y and Z of its own frame O."""

    shape: Shape
    half_m: tuple[float, float, float]  # half widths along X, Y, Z

    def outline(self, X_BO: Array, view: ImageRegion) -> Array:
        """(m, 2) convex outline in ideal pixels of `view`, in order around it."""
        half = np.array(self.half_m)
        if self.shape is Shape.ELLIPSOID:
            points = _horizon(transform(inverse(X_BO), view.X_BV[:3, 3]) / half)
        else:
            points = _RIMS if self.shape is Shape.CYLINDER else _CORNERS
        image = view.image_point(transform(X_BO, points * half)).astype(np.float32)
        return np.asarray(cv2.convexHull(image), dtype=np.float64).reshape(-1, 2)

    def depth(self, X_BO: Array, view: ImageRegion, directions: Array32, inflate: float = 1.0) -> Array:
        """(n,) depth where rays (n, 3) with z = 1 of `view` meet the scaled body; inf for a miss."""
        return self._hit(X_BO, view, directions, np.array(self.half_m) * inflate)[0]

    def front(self, X_BO: Array, view: ImageRegion, directions: Array32) -> tuple[Array, Array]:
        """Depth as in `depth`, and normals (n, 3): unit vectors in the base frame, towards the camera."""
        half = np.array(self.half_m)
        depth, normals = self._hit(X_BO, view, directions, half)
        normal = normals() / half
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return depth, normal @ X_BO[:3, :3].T

    def _hit(self, X_BO: Array, view: ImageRegion, directions: Array32, half_m: Array) -> Hit:
        R = X_BO[:3, :3]
        origin = (view.X_BV[:3, 3] - X_BO[:3, 3]) @ R / half_m
        along = directions.astype(np.float64) @ (view.X_BV[:3, :3].T @ R) / half_m
        with np.errstate(divide="ignore", invalid="ignore"):
            return _FIRST_HIT[self.shape](origin, along)


Hit = tuple[Array, Callable[[], Array]]
"""Depth (n,) along rays, inf for a miss, and the normals (n, 3) of the unit body, which take as long to compute."""


def _horizon(eye: Array) -> Array:
    """(m, 3) circle on the unit sphere where rays from `eye` (3,) touch it."""
    distance = np.linalg.norm(eye)
    axis = eye / distance
    side = np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    radius = np.sqrt(1 - 1 / distance**2)
    circle: Array = axis / distance + radius * (_RING[:, :1] * side + _RING[:, 1:] * np.cross(axis, side))
    return circle


def _unit_sphere(origin: Array, along: Array) -> Hit:
    a, b, c = np.einsum("ni,ni->n", along, along), along @ origin, origin @ origin - 1
    root = b * b - a * c
    t = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    hit = np.isfinite(t)
    return t, lambda: np.where(hit[:, None], origin + np.where(hit, t, 0)[:, None] * along, 1.0)


def _unit_cylinder(origin: Array, along: Array) -> Hit:
    flat = along[:, :2]
    a, b, c = np.einsum("ni,ni->n", flat, flat), flat @ origin[:2], origin[:2] @ origin[:2] - 1
    root = np.sqrt(np.maximum(b * b - a * c, 0))
    enter, leave = (-b - root) / a, (-b + root) / a
    near, far = _slab(origin[2], along[:, 2])
    t = np.maximum(enter, near)
    hit = (b * b - a * c > 0) & (t < np.minimum(leave, far))

    def normals() -> Array:
        side = np.concatenate([origin[:2] + t[:, None] * flat, np.zeros((len(t), 1))], axis=1)
        cap = np.zeros_like(along)
        cap[:, 2] = -np.sign(along[:, 2])
        return np.where(hit[:, None], np.where((enter > near)[:, None], side, cap), 1.0)

    return np.where(hit, t, np.inf), normals


def _unit_box(origin: Array, along: Array) -> Hit:
    near, far = zip(*(_slab(origin[i], along[:, i]) for i in range(3)), strict=True)
    entries = np.stack(near, axis=1)
    t = entries.max(axis=1)
    hit = t < np.stack(far, axis=1).min(axis=1)

    def normals() -> Array:
        rows, face = np.arange(len(t)), entries.argmax(axis=1)
        normal = np.zeros_like(along)
        normal[rows, face] = -np.sign(along[rows, face])
        return np.where(hit[:, None], normal, 1.0)

    return np.where(hit, t, np.inf), normals


def _slab(origin: float, along: Array) -> tuple[Array, Array]:
    one, other = (-1 - origin) / along, (1 - origin) / along
    return np.minimum(one, other), np.maximum(one, other)


_FIRST_HIT = {Shape.ELLIPSOID: _unit_sphere, Shape.CYLINDER: _unit_cylinder, Shape.BOX: _unit_box}


def coverage(outline: Array, xy: Array32) -> tuple[NDArray[np.intp], Array32, Array32]:
    """How much of the pixels at `xy` (n, 2) a convex outline (m, 2) covers.

    Returns (k,) indices of the pixels near it, their covered shares (k,), and the derivatives of these by a shift of
    the outline along u and v, (k, 2) per pixel. All other pixels are not covered.
    """
    low, high = outline.min(axis=0) - 1, outline.max(axis=0) + 1
    u, v = xy[:, 0], xy[:, 1]
    near = np.flatnonzero((u > low[0]) & (u < high[0]) & (v > low[1]) & (v < high[1]))
    following = np.roll(outline, -1, axis=0)
    edge = following - outline
    length = np.sqrt(edge[:, 0] ** 2 + edge[:, 1] ** 2)
    keep = length > 1e-6
    edge, start = edge[keep] / length[keep, None], outline[keep]
    turn = np.sign(np.sum(outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1]))
    normal = (turn * np.stack([edge[:, 1], -edge[:, 0]], axis=1)).astype(np.float32)
    distance = xy[near] @ normal.T - (normal * start).sum(axis=1).astype(np.float32)
    nearest = distance.argmax(axis=1)
    share: Array32 = np.float32(0.5) - distance[np.arange(len(near)), nearest]
    change = np.where(((share > 0) & (share < 1))[:, None], normal[nearest], np.float32(0))
    return near, np.clip(share, 0, 1), change
