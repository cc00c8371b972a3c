"""The looks of the arm: one table of primitives for both the URDF and the camera's meshes.

The shapes follow the arm's outline by eye, in the maker's link frames (`hw.kinematics`); they are not the
maker's meshes. Lengths in metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.types import Visual, merged

Rgb = tuple[float, float, float]

WHITE: Rgb = (0.88, 0.89, 0.90)
GREY: Rgb = (0.42, 0.44, 0.46)
DARK: Rgb = (0.10, 0.11, 0.12)

_SEGMENTS = 20


@dataclass(frozen=True)
class Primitive:
    """A solid of a link. `size` is (radius, length) of a cylinder, (radius,) of a sphere, the three edges of a box."""

    link: str
    kind: Literal["cylinder", "sphere", "box"]
    size: tuple[float, ...]
    centre: tuple[float, float, float]
    axis: Literal["x", "y", "z"] = "z"  # of a cylinder
    rgb: Rgb = WHITE


def _joint(link: str, centre: tuple[float, float, float], axis: Literal["x", "y", "z"]) -> tuple[Primitive, ...]:
    """A motor housing across a joint: a white cylinder with a dark cap at each end."""
    return (
        Primitive(link, "cylinder", (0.058, 0.126), centre, axis),
        Primitive(link, "cylinder", (0.049, 0.142), centre, axis, DARK),
    )


PRIMITIVES: tuple[Primitive, ...] = (
    Primitive("panda_link0", "box", (0.205, 0.186, 0.060), (-0.045, 0.0, 0.030)),
    Primitive("panda_link0", "cylinder", (0.093, 0.060), (0.0, 0.0, 0.030)),
    Primitive("panda_link0", "cylinder", (0.070, 0.135), (0.0, 0.0, 0.0675)),
    Primitive("panda_link0", "box", (0.080, 0.100, 0.090), (-0.105, 0.0, 0.075), rgb=GREY),
    Primitive("panda_link1", "cylinder", (0.062, 0.190), (0.0, 0.0, -0.100)),
    Primitive("panda_link1", "cylinder", (0.063, 0.010), (0.0, 0.0, -0.193), rgb=DARK),
    *_joint("panda_link1", (0.0, 0.0, 0.0), "y"),
    Primitive("panda_link2", "cylinder", (0.057, 0.180), (0.0, -0.100, 0.0), "y"),
    Primitive("panda_link2", "sphere", (0.060,), (0.0, 0.0, 0.0)),
    Primitive("panda_link2", "cylinder", (0.058, 0.008), (0.0, -0.192, 0.0), "y", DARK),
    Primitive("panda_link3", "cylinder", (0.057, 0.110), (0.0, 0.0, -0.065)),
    Primitive("panda_link3", "sphere", (0.060,), (0.0, 0.0, -0.010)),
    Primitive("panda_link3", "cylinder", (0.055, 0.0825), (0.04125, 0.0, -0.004), "x"),
    *_joint("panda_link3", (0.0825, 0.0, 0.0), "y"),
    Primitive("panda_link4", "cylinder", (0.055, 0.0825), (-0.04125, 0.004, 0.0), "x"),
    Primitive("panda_link4", "sphere", (0.060,), (-0.0825, 0.010, 0.0)),
    Primitive("panda_link4", "cylinder", (0.057, 0.100), (-0.0825, 0.060, 0.0), "y"),
    Primitive("panda_link4", "cylinder", (0.058, 0.008), (-0.0825, 0.114, 0.0), "y", DARK),
    Primitive("panda_link5", "cylinder", (0.057, 0.090), (0.0, 0.0, -0.220)),
    Primitive("panda_link5", "sphere", (0.057,), (0.0, 0.0, -0.175)),
    Primitive("panda_link5", "sphere", (0.036,), (0.0, 0.055, -0.150)),
    Primitive("panda_link5", "cylinder", (0.036, 0.130), (0.0, 0.055, -0.085)),
    Primitive("panda_link5", "box", (0.072, 0.045, 0.130), (0.0, 0.030, -0.110)),
    Primitive("panda_link5", "cylinder", (0.050, 0.100), (0.0, 0.010, 0.0), "y"),
    Primitive("panda_link5", "cylinder", (0.042, 0.116), (0.0, 0.010, 0.0), "y", DARK),
    Primitive("panda_link6", "sphere", (0.051,), (0.0, 0.0, 0.0)),
    Primitive("panda_link6", "cylinder", (0.046, 0.088), (0.044, 0.0, 0.0), "x"),
    Primitive("panda_link6", "cylinder", (0.049, 0.090), (0.088, 0.010, 0.0), "y"),
    Primitive("panda_link6", "cylinder", (0.043, 0.106), (0.088, 0.012, 0.0), "y", DARK),
    Primitive("panda_link7", "cylinder", (0.046, 0.060), (0.0, 0.0, 0.060)),
    Primitive("panda_link7", "box", (0.045, 0.040, 0.035), (0.045, 0.0, 0.075), rgb=GREY),
    Primitive("panda_link7", "cylinder", (0.0315, 0.017), (0.0, 0.0, 0.0985), rgb=GREY),
    Primitive("panda_hand", "box", (0.046, 0.204, 0.050), (0.0, 0.0, 0.030)),
    Primitive("panda_hand", "cylinder", (0.032, 0.012), (0.0, 0.0, 0.006), rgb=GREY),
    Primitive("panda_hand", "box", (0.020, 0.014, 0.046), (0.0, 0.018, 0.080), rgb=DARK),
    Primitive("panda_hand", "box", (0.020, 0.014, 0.046), (0.0, -0.018, 0.080), rgb=DARK),
)


def visuals() -> tuple[Visual, ...]:
    """The arm as a camera sees it: one mesh for each link and colour."""
    groups: dict[tuple[str, Rgb], list[tuple[Array, NDArray[np.int32]]]] = {}
    for primitive in PRIMITIVES:
        groups.setdefault((primitive.link, primitive.rgb), []).append(mesh(primitive))
    return tuple(Visual(link, *merged(parts), rgb) for (link, rgb), parts in groups.items())


def mesh(primitive: Primitive) -> tuple[Array, NDArray[np.int32]]:
    """Vertices (V, 3) in the link's frame and outward triangles (F, 3)."""
    if primitive.kind == "box":
        rings = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2.0 * np.array(primitive.size[:2])
        half = primitive.size[2] / 2.0
        vertices, triangles = _lathe([(rings, -half), (rings, half)])
    else:
        turn = 2.0 * np.pi * np.arange(_SEGMENTS) / _SEGMENTS
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        if primitive.kind == "cylinder":
            radius, length = primitive.size
            profile = [(radius, -length / 2.0), (radius, length / 2.0)]
        else:
            polar = np.linspace(-np.pi / 2.0, np.pi / 2.0, _SEGMENTS // 2)[1:-1]
            profile = [(primitive.size[0] * np.cos(a), primitive.size[0] * np.sin(a)) for a in polar]
        vertices, triangles = _lathe([(radius * circle, z) for radius, z in profile])
    shift = {"x": 1, "y": 2, "z": 0}[primitive.axis]  # permute the axes cyclically: z becomes x or y
    return np.roll(vertices, shift, axis=1) + np.array(primitive.centre), triangles


def _lathe(rings: list[tuple[Array, float]]) -> tuple[Array, NDArray[np.int32]]:
    """Join rings of n points, counter-clockwise and from bottom to top, and close both ends."""
    n = len(rings[0][0])
    vertices = np.concatenate([np.column_stack([ring, np.full(n, z)]) for ring, z in rings])
    here, following = np.arange(n), (np.arange(n) + 1) % n
    triangles = []
    for level in range(len(rings) - 1):
        a, b = here + level * n, following + level * n
        triangles += [np.stack([a, b, b + n], axis=1), np.stack([a, b + n, a + n], axis=1)]
    middle, top = np.arange(1, n - 1), (len(rings) - 1) * n
    triangles.append(np.stack([np.zeros_like(middle), middle + 1, middle], axis=1))
    triangles.append(np.stack([np.full_like(middle, top), top + middle, top + middle + 1], axis=1))
    return vertices, np.concatenate(triangles).astype(np.int32)
