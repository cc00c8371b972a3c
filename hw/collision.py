"""Collision geometry: capsules of links and tool, keep-out boxes, the table, and the distances between them.

The capsules are those of the maker's coarse collision model (robot description, "self collision"), in the frames of
`hw.kinematics`. Distances are exact and vectorised over all leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from hw.kinematics import FLANGE
from hw.mass import Mass
from hw.types import REACH_M, Array, frozen_array, number

Side = Literal["left", "right", "front", "back"]
"""Seen from the base along its X axis."""

_CLOSEST_M = 0.2


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius_m` of a segment that is fixed in a link (0 base, 1..7 links, 8 flange)."""

    name: str
    link: int
    start_m: Array  # (3,) in the link's frame
    end_m: Array  # (3,)
    radius_m: float

    def __post_init__(self) -> None:
        number(self.link, f"link of {self.name}", 0, FLANGE)
        number(self.radius_m, f"radius of {self.name}", 0.0, REACH_M, "m")
        object.__setattr__(self, "start_m", frozen_array(self.start_m, (3,), f"start of {self.name}", most=REACH_M))
        object.__setattr__(self, "end_m", frozen_array(self.end_m, (3,), f"end of {self.name}", most=REACH_M))


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
    """Everything on the flange, hand included: mass, capsules that must stay clear, points that may touch the table."""

    name: str
    mass: Mass  # in the flange
    capsules: tuple[Capsule, ...] = ()
    points_F_m: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (P, 3) in the flange

    def __post_init__(self) -> None:
        points_F_m = frozen_array(self.points_F_m, (None, 3), f"points of {self.name}", most=REACH_M)
        object.__setattr__(self, "points_F_m", points_F_m)


def _capsule(name: str, link: int, start: tuple[float, ...], end: tuple[float, ...], radius: float) -> Capsule:
    return Capsule(name, link, np.array(start), np.array(end), radius)


ARM: tuple[Capsule, ...] = (
    _capsule("base", 0, (-0.09, 0.0, 0.06), (-0.06, 0.0, 0.06), 0.06),
    _capsule("link 1", 1, (0.0, 0.0, -0.333), (0.0, 0.0, -0.05), 0.06),
    _capsule("link 2", 2, (0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),
    _capsule("link 3", 3, (0.0, 0.0, -0.22), (0.0, 0.0, -0.07), 0.06),
    _capsule("link 4", 4, (0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),
    _capsule("link 5", 5, (0.0, 0.0, -0.31), (0.0, 0.0, -0.21), 0.06),
    _capsule("forearm", 5, (0.0, 0.08, -0.20), (0.0, 0.08, -0.06), 0.025),
    _capsule("link 6", 6, (0.0, 0.0, -0.07), (0.0, 0.0, 0.01), 0.05),
    _capsule("link 7", 7, (0.0, 0.0, -0.06), (0.0, 0.0, 0.08), 0.04),
    _capsule("guide button", 7, (0.06, 0.0, 0.077), (0.06, 0.0, 0.087), 0.03),
)

_DIAGONAL = 0.1 / 2.0 * np.sqrt(0.5)  # the hand is rotated by -45° about the flange's axis

HAND: tuple[Capsule, ...] = (
    _capsule("hand", FLANGE, (-_DIAGONAL, -_DIAGONAL, 0.04), (_DIAGONAL, _DIAGONAL, 0.04), 0.04),
    _capsule("fingers", FLANGE, (0.0, 0.0, 0.08), (0.0, 0.0, 0.095), 0.022),
)

HAND_MASS = Mass(0.73, np.array([-0.01, 0.0, 0.03]), np.diag([0.001, 0.0025, 0.0017]))
"""The Franka Hand in the flange (the maker's values, as Desk has them)."""

BARE_HAND = Tool("bare hand", HAND_MASS, HAND)


def segments(poses: Array, capsules: tuple[Capsule, ...]) -> Array:
    """Link poses (..., 9, 4, 4) -> (..., C, 2, 3): both ends of every capsule's segment in the base frame."""
    links = [c.link for c in capsules]
    ends = np.array([[c.start_m, c.end_m] for c in capsules]).reshape(-1, 2, 3)
    chosen = poses[..., links, :, :]
    return np.asarray(np.einsum("...cij,ckj->...cki", chosen[..., :3, :3], ends) + chosen[..., None, :3, 3])


def segment_distance(a: Array, b: Array) -> Array:
    """Smallest distance between segments (..., 2, 3) and (..., 2, 3) -> (...).

    Closest points as in Ericson, "Real-Time Collision Detection" (2005), 5.1.9.
    """
    d1, d2, r = a[..., 1, :] - a[..., 0, :], b[..., 1, :] - b[..., 0, :], a[..., 0, :] - b[..., 0, :]
    aa, ee, ab = _dot(d1, d1), _dot(d2, d2), _dot(d1, d2)
    ar, br = _dot(d1, r), _dot(d2, r)
    tiny = 1e-18
    det = aa * ee - ab * ab
    s = np.where(det > 1e-12 * (aa * ee + tiny), np.clip((ab * br - ar * ee) / np.maximum(det, tiny), 0.0, 1.0), 0.0)
    t = np.clip((ab * s + br) / np.maximum(ee, tiny), 0.0, 1.0)
    s = np.clip((ab * t - ar) / np.maximum(aa, tiny), 0.0, 1.0)
    gap = r + s[..., None] * d1 - t[..., None] * d2
    return np.sqrt(_dot(gap, gap))


def box_distance(segment: Array, low_m: Array, high_m: Array) -> Array:
    """Smallest distance between segments (..., 2, 3) and a box; 0 where a segment enters it.

    Along a segment, half the derivative of the squared distance is piecewise linear and rises, with breaks at the
    planes of the box. So its zero lies between two of the crossings.
    """
    start, step = segment[..., 0, :], segment[..., 1, :] - segment[..., 0, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.concatenate([(low_m - start) / step, (high_m - start) / step], axis=-1)
    crossing = np.clip(np.where(np.isfinite(crossing), crossing, 0.0), 0.0, 1.0)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*crossing.shape[:-1], 2))
    at = np.sort(np.concatenate([crossing, ends], axis=-1), axis=-1)  # (..., 8)
    point = start[..., None, :] + at[..., None] * step[..., None, :]
    outside = point - np.clip(point, low_m, high_m)
    slope = _dot(outside, np.broadcast_to(step[..., None, :], outside.shape))  # rising along the last axis
    upper = np.clip((slope < 0.0).sum(axis=-1), 1, at.shape[-1] - 1)[..., None]
    t0, t1 = np.take_along_axis(at, upper - 1, -1), np.take_along_axis(at, upper, -1)
    f0, f1 = np.take_along_axis(slope, upper - 1, -1), np.take_along_axis(slope, upper, -1)
    share = np.clip(-f0 / np.where(f1 > f0, f1 - f0, 1.0), 0.0, 1.0)
    closest = start + (t0 + share * (t1 - t0)) * step
    gap = closest - np.clip(closest, low_m, high_m)
    return np.sqrt(_dot(gap, gap))


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
    """Link poses (N, 9, 4, 4) -> (N - 1, P): how much closer (m) each pair of `self_clearance` may come in a step."""
    capsules, first, second = _pairs(tool)
    travel = _travel(poses, capsules)
    return np.asarray(travel[:, first] + travel[:, second])


def _pairs(tool: Tool) -> tuple[tuple[Capsule, ...], list[int], list[int]]:
    capsules = (*ARM, *tool.capsules)
    pairs = [
        (i, j)
        for i, a in enumerate(capsules)
        for j, b in enumerate(capsules)
        if i < j and _chain(b) - _chain(a) >= 2 and (a.link, b.link) not in ((5, 7), (1, 3), (3, 5))
    ]
    return capsules, [i for i, _ in pairs], [j for _, j in pairs]


def _travel(poses: Array, capsules: tuple[Capsule, ...]) -> Array:
    """Link poses (N, 9, 4, 4) -> (N - 1, C): how far the ends of each capsule go from one sample to the next."""
    return np.asarray(np.linalg.norm(np.diff(segments(poses, capsules), axis=0), axis=-1).max(axis=-1))


def box_clearance(poses: Array, tool: Tool, box: KeepOut) -> tuple[Array, tuple[str, ...]]:
    """Link poses (..., 9, 4, 4) -> clearances (..., C) in m between a box and everything that moves, and names.

    These are the capsules of arm and tool, and the tool's points that may touch the table.
    """
    capsules = _moving(tool)
    radii = np.array([c.radius_m for c in capsules])
    clearance = box_distance(segments(poses, capsules), box.low_m, box.high_m) - radii
    return clearance, tuple(f"{c.name} and {box.name}" for c in capsules)


def box_travel(poses: Array, tool: Tool) -> Array:
    """Link poses (N, 9, 4, 4) -> (N - 1, C): travel (m) of each item of `box_clearance` in a step."""
    return _travel(poses, _moving(tool))


def _moving(tool: Tool) -> tuple[Capsule, ...]:
    points = tuple(Capsule(f"tip of {tool.name}", FLANGE, p, p, 0.0) for p in tool.points_F_m)
    return (*(c for c in (*ARM, *tool.capsules) if c.link >= 1), *points)


def table_clearance(poses: Array, tool: Tool, table: Table) -> tuple[Array, tuple[str, ...]]:
    """Link poses (..., 9, 4, 4) -> heights (..., C) in m above the table of the capsules that must not touch it, and
    names.

    Links 0 and 1 stand on the table and are left out.
    """
    capsules = tuple(c for c in (*ARM, *tool.capsules) if c.link >= 2)
    radii = np.array([c.radius_m for c in capsules])
    ends = segments(poses, capsules)
    return (ends[..., 2] - table.height_at(ends)).min(axis=-1) - radii, tuple(f"{c.name} and table" for c in capsules)


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


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))
