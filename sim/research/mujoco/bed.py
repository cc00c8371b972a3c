"""The surface of a piece of food as a bed of points, each with the stiffness of its share of the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from hw.types import Array
from sim.tasks.scooping.piece import BOX, CYLINDER, Piece

POINT_M = 0.0002
"""Radius of a point."""

_CUTS = 4
"""How often each triangle is divided into four, to distribute the surface over the points."""


@dataclass(frozen=True, eq=False)
class Bed:
    """A bed of points on the surface."""

    points_m: Array  # (N, 3) centres of small spheres, each inside the surface by its radius
    share: Array  # (N,) shares of the surface: area over the distance of its plane from the centre, m

    def stiffness_N_m(self, weight_N: float, sink_m: float) -> Array:
        """(N,) spring constants, in proportion to the shares, that carry the piece's weight at the depth `sink_m`."""
        deep_m = np.maximum(self.points_m[:, 2].min() + sink_m - self.points_m[:, 2], 0.0)
        return np.asarray(self.share * weight_N / (self.share @ deep_m))


def bed_of(piece: Piece, g: int) -> Bed:
    """The points of a piece of shape `g` (see `sim.tasks.scooping.piece.make_piece`).

    The pressure of hydroelastic contact rises from the surface to the centre, by e over the distance of the face from
    the centre. So a point with area A is a spring of e A / distance. Each part of the surface belongs to the nearest
    point.
    """
    half_m = piece.vertices_m.max(axis=0)
    points_m = _on_box(half_m) if g == BOX else _on_cylinder(piece) if g == CYLINDER else piece.vertices_m
    corners = piece.vertices_m[piece.triangles]
    for _ in range(_CUTS):
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # twice the area long
    areas = np.linalg.norm(normals, axis=1) / 2.0
    distances_m = np.einsum("fi,fi->f", normals, corners[:, 0]) / (2.0 * areas)
    owner = cKDTree(points_m).query(corners.mean(axis=1))[1]
    share = np.bincount(owner, areas / distances_m, len(points_m)).astype(np.float64)
    return Bed(points_m * (1.0 - POINT_M / half_m), share)


def _on_box(half_m: Array) -> Array:
    """(98, 3) a grid of five lines along each edge."""
    line = np.linspace(-1.0, 1.0, 5)
    grid = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    return np.asarray(grid[np.abs(grid).max(axis=1) == 1.0] * half_m)


def _on_cylinder(piece: Piece) -> Array:
    """(N, 3) the corners of both ends, a ring half as wide and the centre of each, and three rings between."""
    low = piece.vertices_m[piece.vertices_m[:, 2] < 0.0]
    inner = np.concatenate([low[::2] * [0.5, 0.5, 1.0], low[:1] * [0.0, 0.0, 1.0]])
    ends = np.concatenate([low, inner])
    between = [low * [1.0, 1.0, z] for z in (0.5, 0.0, -0.5)]
    return np.concatenate([ends, ends * [1.0, 1.0, -1.0], *between])
