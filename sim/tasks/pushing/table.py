"""Contact geometry of the table with its patch: flat, and each part with its own friction.

Two flush rigid surfaces, the patch and the table around it, each an open sheet of triangles at z = 0. A bottle across
the seam has one contact surface with each, over the part of its bottom that lies there, and the seam has no wall to run
into. Every sheet has one unused vertex far below, so that its hull has a volume.
"""

from __future__ import annotations

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

from hw.types import Array
from sim.errors import OutOfRange
from sim.tasks.shared.shapes import TABLE_CORNERS_M

_FAR_BELOW_M = -1.0


def on_table(xy_m: Array) -> bool:
    """Whether a point lies over the table."""
    (x0, y0), (x1, y1) = TABLE_CORNERS_M[:, :2]
    return bool(x0 <= xy_m[0] <= x1 and y0 <= xy_m[1] <= y1)


def table_around(x_m: tuple[float, float], y_m: tuple[float, float]) -> Mesh:
    """The table without the rectangle. Raises OutOfRange if it does not lie within the table."""
    outer, inner = _corners(*TABLE_CORNERS_M[:, :2].T), _corners(x_m, y_m)
    if not (on_table(inner[0]) and on_table(inner[2])):
        raise OutOfRange(
            f"the patch, x {x_m[0]:.3f} to {x_m[1]:.3f} m, y {y_m[0]:.3f} to {y_m[1]:.3f} m, leaves the table: move "
            "the bottle away from the edge"
        )
    sides = [(i, (i + 1) % 4) for i in range(4)]
    return _sheet([*outer, *inner], [t for i, j in sides for t in ((i, j, 4 + j), (i, 4 + j, 4 + i))])


def patch(x_m: tuple[float, float], y_m: tuple[float, float]) -> Mesh:
    """The rectangle."""
    return _sheet(list(_corners(x_m, y_m)), [(0, 1, 2), (0, 2, 3)])


def _corners(x_m: Array | tuple[float, float], y_m: Array | tuple[float, float]) -> Array:
    """(4, 2) counter-clockwise from above."""
    (x0, x1), (y0, y1) = x_m, y_m
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _sheet(points_m: list[Array], triangles: list[tuple[int, int, int]]) -> Mesh:
    lines = [f"v {x:.9g} {y:.9g} 0" for x, y in points_m]
    lines += ["v {:.9g} {:.9g} {:.9g}".format(*points_m[0], _FAR_BELOW_M)]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", "sheet.obj")), 1.0)
