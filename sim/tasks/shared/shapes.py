"""Triangle meshes for the camera, the table that all tasks share, and solids to print."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hw.extras import install_line
from hw.poses import translation
from hw.types import Array
from sim.errors import ExtraMissing
from sim.types import Visual

if TYPE_CHECKING:
    import trimesh


Shape = tuple[Array, NDArray[np.int32]]
"""Vertices (V, 3) in m and triangles (F, 3), counter-clockwise seen from outside."""

TABLE_CORNERS_M = np.array([[0.30, -0.60, -0.03], [1.20, 0.60, 0.0]])
_TABLE = (0.55, 0.53, 0.50)


def table_visual() -> Visual:
    """The table in front of the robot; its top is at z = 0."""
    return Visual("world", *box(TABLE_CORNERS_M[1] - TABLE_CORNERS_M[0], TABLE_CORNERS_M.mean(axis=0)), _TABLE)


def box(size_m: Array, centre_m: Array, pitch_rad: float = 0.0) -> Shape:
    """A box rotated by `pitch_rad` about Y (positive: its X end down)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size_m
    cos, sin = np.cos(pitch_rad), np.sin(pitch_rad)
    turned = corners @ np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]).T
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    return turned + centre_m, triangles


def obj_text(vertices_m: Array, triangles: NDArray[np.integer]) -> str:
    """A mesh (V, 3), (F, 3) as a Wavefront OBJ."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices_m]
    lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    return "\n".join(lines) + "\n"


def turned_body(outline_m: Array, sides: int) -> Shape:
    """A body of revolution about Z from its `outline_m` (K, 2) of (radius, z), upwards, closed at both ends."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.full(sides, z)], axis=-1) for r, z in outline_m]
    ends = np.array([[0.0, 0.0, outline_m[0, 1]], [0.0, 0.0, outline_m[-1, 1]]])
    i, j = np.arange(sides), np.roll(np.arange(sides), -1)
    walls = [
        part
        for k in range(len(rings) - 1)
        for low, high in [(k * sides, (k + 1) * sides)]
        for part in (np.stack([low + i, low + j, high + j], axis=-1), np.stack([low + i, high + j, high + i], axis=-1))
    ]
    bottom, top, last = len(rings) * sides, len(rings) * sides + 1, (len(rings) - 1) * sides
    caps = [np.stack([np.full(sides, bottom), j, i], axis=-1), np.stack([np.full(sides, top), last + i, last + j], -1)]
    return np.concatenate([*rings, ends]), np.concatenate([*walls, *caps]).astype(np.int32)


SCREW_M = 0.0034
"""Diameter of a through hole for M3."""


def library() -> Any:
    """The module trimesh. Raises ExtraMissing without it or manifold3d."""
    try:
        import manifold3d  # noqa: F401, PLC0415 - an extra; trimesh joins and cuts with it
        import trimesh  # noqa: PLC0415
    except ImportError as error:
        raise ExtraMissing(f"parts need trimesh and manifold3d: {install_line('parts')}") from error
    return trimesh


def solid_box(size_m: tuple[float, ...], centre_m: tuple[float, float, float]) -> trimesh.Trimesh:
    """A box along the axes, to print."""
    return library().creation.box(extents=size_m, transform=translation(centre_m))


def hole(centre_m: tuple[float, float, float], length_m: float) -> trimesh.Trimesh:
    """A cylinder along Z, for a screw of M3, to cut."""
    X = translation(centre_m)
    return library().creation.cylinder(radius=SCREW_M / 2, height=2 * length_m, sections=32, transform=X)


def joined(*solids: trimesh.Trimesh) -> trimesh.Trimesh:
    """The solids as one."""
    return library().boolean.union(solids, engine="manifold")


def cut(solid: trimesh.Trimesh, *others: trimesh.Trimesh) -> trimesh.Trimesh:
    """The solid without the others."""
    return library().boolean.difference([solid, *others], engine="manifold")


def simplified(solid: trimesh.Trimesh, tolerance: float) -> trimesh.Trimesh:
    """The solid without edges shorter than `tolerance`, in its own unit."""
    from manifold3d import Manifold, Mesh  # noqa: PLC0415 - an extra

    mesh = Manifold(Mesh(np.asarray(solid.vertices, np.float32), np.asarray(solid.faces, np.uint32)))
    plain = mesh.simplify(tolerance).to_mesh()
    return library().Trimesh(plain.vert_properties[:, :3].astype(np.float64), plain.tri_verts, process=False)
