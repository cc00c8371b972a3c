"""Collision geometry: the tool, keep-out boxes, the table, and the clearances of the arm's bodies.

There are two models of the arm (`hw.outline`). Boxes and table are checked against an outline that contains the real
arm. Self-collision is checked with the maker's own capsules, which are thinner. All clearances are exact and vectorised
over the leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from hw.capsules import Capsule, box_distance, segment_distance, segments, travel
from hw.kinematics import FLANGE
from hw.mass import Mass
from hw.outline import ARM, COARSE_ARM, COARSE_HAND, FINGERS, HAND
from hw.types import REACH_M, Array, frozen_array, number

Side = Literal["left", "right", "front", "back"]
"""Seen from the base along its X axis."""

_CLOSEST_M = 0.2


@dataclass(frozen=True, eq=False)
class KeepOut:
    """A box, along the axes of the base frame, that neither arm nor tool may enter: a camera, a person's side."""

    name: str
    low_m: Array  # (3,)
    high_m: Array  # (3,)

    def __post_init__(self) -> None:
        for name, which in (("low_m", "lower"), ("high_m", "upper")):
            corner = frozen_array(getattr(self, name), (3,), f"{which} corner of {self.name}", most=REACH_M)
            object.__setattr__(self, name, corner)
        if (self.low_m >= self.high_m).any():
            raise ValueError(f"keep-out box {self.name}: the lower corner {self.low_m} is not below {self.high_m}")


@dataclass(frozen=True)
class Table:
    """The plane of the table top in the base frame: z = height + slope_x x + slope_y y."""

    height_m: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0

    def __post_init__(self) -> None:
        number(self.height_m, "height of the table", -REACH_M, REACH_M, "m")
        for slope in (self.slope_x, self.slope_y):
            number(slope, "slope of the table", -MOST_SLOPE, MOST_SLOPE)

    def height_at(self, p_m: Array) -> Array:
        """Points (..., 3) or (..., 2) in m -> height (...) in m of the table top there."""
        return np.asarray(self.height_m + self.slope_x * p_m[..., 0] + self.slope_y * p_m[..., 1])

    @property
    def X_BW(self) -> Array:
        """(4, 4) the table's own frame W in the base: over the base's origin, Z along the normal, X forward."""
        normal = np.array([-self.slope_x, -self.slope_y, 1.0])
        z = normal / np.linalg.norm(normal)
        x = np.array([1.0, 0.0, self.slope_x]) / np.hypot(1.0, self.slope_x)
        X = np.eye(4)
        X[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        X[2, 3] = self.height_m
        return X


MOST_SLOPE = 0.1
"""About 6°: a plane that leans more is rejected as a table."""

LEVEL = Table()
"""The table top at z = 0 of the base frame, unless a touch-off says otherwise."""


@dataclass(frozen=True, eq=False)
class Tool:
    """Everything on the flange, hand included: its mass, and capsules and points that contain it."""

    name: str
    mass: Mass  # in the flange
    capsules: tuple[Capsule, ...] = ()  # contain what must stay clear of boxes and of the table
    points_F_m: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (P, 3) in the flange, first at the table
    touching: tuple[Capsule, ...] = ()  # contain what may touch the table (`points_F_m` say how deep), but no box
    coarse: tuple[Capsule, ...] | None = None  # for the arm against itself; None: `capsules` and `touching`

    def __post_init__(self) -> None:
        points_F_m = frozen_array(self.points_F_m, (None, 3), f"points of {self.name}", most=REACH_M)
        object.__setattr__(self, "points_F_m", points_F_m)

    @property
    def against_arm(self) -> tuple[Capsule, ...]:
        """The capsules that must stay clear of the arm."""
        return (*self.capsules, *self.touching) if self.coarse is None else self.coarse


HAND_MASS = Mass(0.73, np.array([-0.01, 0.0, 0.03]), np.diag([0.001, 0.0025, 0.0017]))
"""The Franka Hand in the flange (the maker's values, as Desk has them)."""

BARE_HAND = Tool("bare hand", HAND_MASS, (*HAND, *FINGERS), coarse=COARSE_HAND)


NO_POINTS: Array = frozen_array(np.zeros((0, 3)))


def hand_with(
    mass: Mass,
    carried: tuple[Capsule, ...],
    points_F_m: ArrayLike = NO_POINTS,
    touching: tuple[Capsule, ...] = (),
    name: str = "tool",
) -> Tool:
    """A hand that holds something. `mass` is that of both; the rest is as in `Tool`."""
    coarse = (*COARSE_HAND, *carried, *touching)
    return Tool(name, mass, (*HAND, *FINGERS, *carried), np.asarray(points_F_m), touching, coarse)


def self_clearance(poses: Array, tool: Tool) -> tuple[Array, tuple[str, ...]]:
    """Link poses (..., 9, 4, 4) -> clearances (..., P) in m of all pairs that may collide, and the pairs' names.

    Neighbouring links overlap by design and are left out, as is everything fixed to the same link.
    """
    capsules, first, second = _pairs(tool)
    ends = segments(poses, capsules)
    radii = np.array([capsules[i].radius_m + capsules[j].radius_m for i, j in zip(first, second, strict=True)])
    clearance = segment_distance(ends[..., first, :, :], ends[..., second, :, :]) - radii
    names = tuple(f"{capsules[i].name} and {capsules[j].name}" for i, j in zip(first, second, strict=True))
    return clearance, names


def self_travel(poses: Array, tool: Tool) -> Array:
    """Link poses (N, 9, 4, 4) -> (N - 1, P): the most (m) by which each pair of `self_clearance` may approach in a
    step.
    """
    capsules, first, second = _pairs(tool)
    each = travel(poses, capsules)
    return np.asarray(each[:, first] + each[:, second])


def _pairs(tool: Tool) -> tuple[tuple[Capsule, ...], list[int], list[int]]:
    capsules = (*COARSE_ARM, *tool.against_arm)
    pairs = [
        (i, j)
        for i, a in enumerate(capsules)
        for j, b in enumerate(capsules)
        if i < j and _chain(b) - _chain(a) >= 2 and (a.link, b.link) not in ((5, 7), (1, 3), (3, 5))
    ]
    return capsules, [i for i, _ in pairs], [j for _, j in pairs]


def box_clearance(poses: Array, tool: Tool, box: KeepOut) -> tuple[Array, tuple[str, ...]]:
    """Link poses (..., 9, 4, 4) -> clearances (..., C) in m between a box and everything that moves, and names.

    These are the outline of the arm from link 1 on and everything of the tool.
    """
    capsules = moving(tool)
    radii = np.array([c.radius_m for c in capsules])
    clearance = box_distance(segments(poses, capsules), box.low_m, box.high_m) - radii
    return clearance, tuple(f"{c.name} and {box.name}" for c in capsules)


def box_travel(poses: Array, tool: Tool) -> Array:
    """Link poses (N, 9, 4, 4) -> (N - 1, C): travel (m) of each item of `box_clearance` in a step."""
    return travel(poses, moving(tool))


def moving(tool: Tool) -> tuple[Capsule, ...]:
    """Everything that moves: the outline from link 1 on, all of the tool, and its points."""
    points = tuple(Capsule(f"tip of {tool.name}", FLANGE, p, p, 0.0) for p in tool.points_F_m)
    return (*(c for c in (*ARM, *tool.capsules, *tool.touching) if c.link >= 1), *points)


def table_clearance(poses: Array, tool: Tool, table: Table) -> tuple[Array, tuple[str, ...]]:
    """Link poses (..., 9, 4, 4) -> heights (..., C) in m above the table of the capsules that must not touch it, and
    names.

    Links 0 and 1 stand on the table and are left out.
    """
    capsules = tuple(c for c in (*ARM, *tool.capsules) if c.link >= 2)
    lean = np.hypot(1.0, np.hypot(table.slope_x, table.slope_y))  # a ball over a slope is nearer than its lowest point
    below_m = lean * np.array([c.radius_m for c in capsules])
    ends = segments(poses, capsules)
    heights_m = (ends[..., 2] - table.height_at(ends)).min(axis=-1) - below_m
    return heights_m, tuple(f"{c.name} and table" for c in capsules)


def point_heights(poses: Array, tool: Tool, table: Table) -> Array:
    """Link poses (..., 9, 4, 4) -> (..., P): heights (m) above the table of the tool's points that may touch it."""
    flange = poses[..., FLANGE, :, :]
    points = np.einsum("...ij,pj->...pi", flange[..., :3, :3], tool.points_F_m) + flange[..., None, :3, 3]
    return np.asarray(points[..., 2] - table.height_at(points))


CAMERA_ROOM_M = 0.12
"""Half the edge of the box around a camera that the arm keeps out of."""

_FAR_M, _DEEP_M, _TALL_M = 2.0, -0.5, 2.0


def camera_box(X_BC: Array) -> KeepOut:
    """The keep-out box around a camera at X_BC (4, 4), without its stand."""
    at = np.asarray(X_BC)[:3, 3]
    return KeepOut("the camera", at - CAMERA_ROOM_M, at + CAMERA_ROOM_M)


def persons_side(side: Side, from_m: float) -> KeepOut:
    """Everything on the operator's side of the base, farther than `from_m` from the base's axis.

    Raises ValueError for an unknown side, or one that begins inside the base.
    """
    if side not in get_args(Side):
        raise ValueError(f"the person's side is {side!r}: it must be one of {', '.join(get_args(Side))}")
    if not _CLOSEST_M <= from_m < _FAR_M:
        raise ValueError(
            f"the person's side begins {from_m:g} m from the base: it must be {_CLOSEST_M:g} to {_FAR_M:g} m"
        )
    low, high = np.array([-_FAR_M, -_FAR_M, _DEEP_M]), np.array([_FAR_M, _FAR_M, _TALL_M])
    axis = 0 if side in ("front", "back") else 1
    if side in ("front", "left"):
        low[axis] = from_m
    else:
        high[axis] = -from_m
    return KeepOut(f"the person's side ({side})", low, high)


def _chain(capsule: Capsule) -> int:
    return min(capsule.link, 7)
