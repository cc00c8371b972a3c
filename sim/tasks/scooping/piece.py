"""The piece of food as a convex polyhedron, the same body for physics, camera and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from perception.blade import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.errors import OutOfRange
from sim.tasks.scooping.params import BEVEL_M, LIP_M, SQUARE_LIP_M

ELLIPSOID, CYLINDER, BOX = 0, 1, 2
_ROUND_SEGMENTS, _STRAIGHT_SEGMENTS = 16, 12
_RING_ELEVATIONS_RAD = np.deg2rad(np.linspace(-75.0, 75.0, 11))


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex piece, centred at the origin, in its resting orientation with Z up."""

    vertices_m: Array  # (V, 3)
    triangles: NDArray[np.int32]  # (F, 3) counter-clockwise seen from outside
    volume_m3: float
    unit_inertia_m2: Array  # (3, 3) about the centre, per unit of mass, of a homogeneous body


@lru_cache(maxsize=4)  # a rollout asks for its piece three times: to lay it down, for contact, for looks
def make_piece(g: int, height_m: float, half_widths_m: tuple[float, float]) -> Piece:
    """Shape `g` (0 ellipsoid, 1 cylinder, 2 box) of a height and half widths along X and Y.

    The ellipsoid has flat spots above and below, a quarter as wide as itself, so that even a tall one stays where it is
    placed. Raises OutOfRange for another shape.
    """
    if g == ELLIPSOID:
        rings = [(np.cos(a), np.sin(a)) for a in _RING_ELEVATIONS_RAD]
        points = np.concatenate([_ring(_ROUND_SEGMENTS, width, z / rings[-1][1]) for width, z in rings])
    elif g == CYLINDER:
        points = np.concatenate([_ring(_STRAIGHT_SEGMENTS, 1.0, z) for z in (-1.0, 1.0)])
    elif g == BOX:
        points = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    else:
        raise OutOfRange(f"shape g = {g} must be 0 (ellipsoid), 1 (cylinder) or 2 (box)")
    return _solid(points * [*half_widths_m, height_m / 2.0])


SLOPE = (SQUARE_LIP_M - LIP_M) / BEVEL_M
"""Fall of the bevel per length."""


@cache
def blade(lip_m: float = LIP_M) -> Piece:
    """The blade in the tool frame: flat on top, `EDGE_M` thick, its end bevelled down to a lip of `lip_m`.

    A blunter edge has a shorter bevel of the same slope; `SQUARE_LIP_M` has none.
    """
    half_m, under_m, bevel_m = BLADE_WIDTH_M / 2.0, -SQUARE_LIP_M, (SQUARE_LIP_M - lip_m) / SLOPE
    outline = [(-BLADE_LENGTH_M, 0.0), (0.0, under_m + lip_m), (0.0, under_m), (-BLADE_LENGTH_M, under_m)]
    if bevel_m > 0.0:
        outline.insert(1, (-bevel_m, 0.0))
    return _solid(np.array([[x, y, z] for x, z in outline for y in (-half_m, half_m)]))


def _ring(segments: int, width: float, z: float) -> Array:
    angle = 2.0 * np.pi * (np.arange(segments) + 0.5) / segments
    return np.stack([width * np.cos(angle), width * np.sin(angle), np.full(segments, z)], axis=-1)


def _solid(vertices_m: Array) -> Piece:
    """Hull, volume and inertia: sums over the tetrahedra that the faces span with the centre."""
    from scipy.spatial import ConvexHull  # noqa: PLC0415 - slow to import, and tasks are named without a piece

    hull = ConvexHull(vertices_m)
    triangles = hull.simplices.astype(np.int32)
    corners = vertices_m[triangles]  # (F, 3, 3)
    inward = np.linalg.det(corners - vertices_m.mean(axis=0)) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    corners = vertices_m[triangles]
    volumes = np.linalg.det(corners) / 6.0
    total = corners.sum(axis=1)
    second = np.einsum("f,fvi,fvj->ij", volumes, corners, corners) + np.einsum("f,fi,fj->ij", volumes, total, total)
    covariance = second / (20.0 * volumes.sum())
    triangles.flags.writeable = False
    inertia_m2 = np.trace(covariance) * np.eye(3) - covariance
    return Piece(frozen_array(vertices_m), triangles, float(volumes.sum()), frozen_array(inertia_m2))


def obj_text(piece: Piece) -> str:
    """The piece as a Wavefront OBJ."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in piece.vertices_m]
    lines += [f"f {a} {b} {c}" for a, b, c in piece.triangles + 1]
    return "\n".join(lines) + "\n"
