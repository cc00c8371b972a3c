"""The piece of food as a convex polyhedron, the same body for physics, camera and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from hw.dynamics import GRAVITY_M_S2
from hw.types import Array, frozen_array
from perception.types import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.errors import OutOfRange
from sim.tasks.scooping.params import BEVEL_M, LIP_M, NUISANCE, PARAMETERS, SQUARE_LIP_M, ScoopingUnmodelled

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


def piece_of(parameters: Array, nuisance: Array, unmodelled: ScoopingUnmodelled | None) -> Piece:
    """The piece for parameters (p,) and nuisance (n,)."""
    scale = (unmodelled or ScoopingUnmodelled()).semi_axis_scale
    p, radius_m = PARAMETERS.named(parameters), NUISANCE.named(nuisance).radius
    return make_piece(round(p.g), p.h / 100.0, (radius_m * scale[0], radius_m * scale[1]))


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


_CELLS = 12
_STEPS = 14


def sink_m(piece: Piece, mass_kg: float, e_Pa: float) -> float:
    """Depth at which hydroelastic pressure, e (1 - gauge) over the slice at table height, carries the weight.

    The gauge is 1 on the surface and 0 at the centre (Drake's field of a convex piece). Bisection on a grid over a
    quarter of the slice: the pieces are symmetric.
    """
    corners = piece.vertices_m[piece.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    planes = normals / np.einsum("fi,fi->f", normals, corners[:, 0])[:, None]  # gauge(p) = max over planes . p
    half_m = piece.vertices_m.max(axis=0)
    x, y = (half * (np.arange(_CELLS) + 0.5) / _CELLS for half in half_m[:2])
    flat = (planes[:, 0, None, None] * x[:, None] + planes[:, 1, None, None] * y).reshape(len(planes), -1)
    cell_m2 = 4.0 * half_m[0] * half_m[1] / _CELLS**2
    low, high = 0.0, float(half_m[2])
    for _ in range(_STEPS):
        middle = (low + high) / 2.0
        gauge = (flat - planes[:, 2, None] * (half_m[2] - middle)).max(axis=0)
        force_N = e_Pa * np.maximum(1.0 - gauge, 0.0).sum() * cell_m2
        low, high = (middle, high) if force_N < mass_kg * GRAVITY_M_S2 else (low, middle)
    return (low + high) / 2.0
