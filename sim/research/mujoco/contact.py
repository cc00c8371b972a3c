"""Sets spring and damper of MuJoCo's contacts in N/m and Ns/m, which MuJoCo has no parameters for.

MuJoCo makes each contact a constraint with a reference acceleration -b v - k r and a regulariser R = (1 - d) A / d, A
the inverse of the mass that the contact moves. Its force is -(k/R) r - (b/R) v - a/R: a spring k/R, a damper b/R and an
inertia 1/R. Given as "-stiffness, -damping" (solref), k and b are these numbers over d, so that a spring K and a damper
B are solref = (-K, -B) (1 - d) A. The impedance d remains free. No material has the inertia, so d is chosen so that the
damper outweighs it after `INERTIA_S`: 1/R is B times `INERTIA_S`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from hw.types import Array
from sim.tasks.scooping.piece import BOX, CYLINDER, Piece

INERTIA_S = 0.001
"""Longer than two steps, so that no damper overshoots."""

FRICTION_IN_PLANE, FRICTIONLESS = 3, 1


def add_pair(spec: Any, name: str, one: str, other: str, friction: float) -> None:
    """Let two geoms touch: frictionless if `friction` is 0, else with sliding friction only."""
    pair = spec.add_pair(name=name, geomname1=one, geomname2=other)
    pair.condim = FRICTION_IN_PLANE if friction > 0.0 else FRICTIONLESS
    pair.friction = (friction, friction, 0.0, 0.0, 0.0)


def set_softness(model: Any, name: str, stiffness_N_m: float, damping_Ns_m: float) -> None:
    """Spring and damper of every contact of a pair in a compiled model."""
    pair = model.pair(name).id
    bodies = (model.geom_bodyid[geom[pair]] for geom in (model.pair_geom1, model.pair_geom2))
    inverse_mass = float(sum(model.body_invweight0[body, 0] for body in bodies))
    heavier = inverse_mass * damping_Ns_m * INERTIA_S
    d = min(max(heavier / (1.0 + heavier), mujoco.mjMINIMP), mujoco.mjMAXIMP)
    factor = (1.0 - d) * inverse_mass
    model.pair_solref[pair] = (-stiffness_N_m * factor, -damping_Ns_m * factor)
    model.pair_solimp[pair] = (d, d, 0.001, 0.5, 2.0)


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
