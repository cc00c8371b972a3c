"""How far a person has to stay from a moving arm (ISO 13855), and which sides of an arm no box closes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from hw.collision import KeepOut, Side, Tool, box_clearance, persons_side
from hw.kinematics import FLANGE, link_poses
from hw.types import Array, JointPath
from hw.workcell import Workcell

WALKING_M_S = 1.6
"""Speed of approach of a walking person."""
INTRUSION_M = 0.85
"""How far a hand is ahead of a person whom nothing detects before the hand."""
REACH_M = 0.855
"""Reach of both arms, from the axis of joint 1 to the flange (the maker's data sheets)."""
SIDE_M = 0.6
"""Where a side begins that the rig file does not describe: at the default of `[person] from_m`."""
_EVERY = 20
_GRID_M = 0.05
_HIGHEST_M = 1.2


def separation_m(stopping_s: float) -> float:
    """S = K T + C: the least distance (m) from a hazard that needs `stopping_s` to come to rest."""
    return WALKING_M_S * stopping_s + INTRUSION_M


@dataclass(frozen=True)
class SideDistance:
    """The person's side beside the separation distance."""

    from_m: float  # where the side begins, from the base's axis
    nearest_m: float  # the least distance of the planned motions from it
    separation_m: float

    @property
    def is_near(self) -> bool:
        """Whether a person at the edge of the side is nearer to the arm than the separation distance."""
        return self.nearest_m < self.separation_m

    @property
    def line_m(self) -> float:
        """The distance that a person must keep from the base's axis: the separation distance beyond the edge of the
        side.
        """
        return self.from_m + self.separation_m


def nearest_m(box: KeepOut, cell: Workcell, paths: Sequence[JointPath]) -> float:
    """The least distance (m) of arm and tool from `box` in any path (reported joints)."""
    return min(
        float(box_clearance(link_poses(cell.arm.true_rad(path.q_rad[::_EVERY])), cell.tool, box)[0].min())
        for path in paths
    )


def tool_reach_m(tool: Tool) -> float:
    """How far the tool reaches beyond the flange's origin."""
    ends = [(point, 0.0) for point in tool.points_F_m]
    ends += [(p, c.radius_m) for c in tool.capsules if c.link == FLANGE for p in (c.start_m, c.end_m)]
    return max((float(np.linalg.norm(p)) + radius_m for p, radius_m in ends), default=0.0)


def open_sides(boxes: Sequence[KeepOut], reach_m: float) -> tuple[Side, ...]:
    """The sides of the base, beyond `SIDE_M`, that no box covers wholly, so that the arm may reach into them."""
    steps = np.arange(-reach_m, reach_m + _GRID_M, _GRID_M)
    x, y, z = np.meshgrid(steps, steps, np.arange(0.0, _HIGHEST_M, 2.0 * _GRID_M), indexing="ij")
    points: Array = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    points = points[np.hypot(points[:, 0], points[:, 1]) <= reach_m]
    free = np.ones(len(points), dtype=bool)
    for box in boxes:
        free &= ~((points >= box.low_m) & (points <= box.high_m)).all(axis=1)
    sides: tuple[Side, ...] = get_args(Side)
    return tuple(side for side in sides if _holds(persons_side(side, SIDE_M), points[free]))


def _holds(box: KeepOut, points: Array) -> bool:
    return bool(((points >= box.low_m) & (points <= box.high_m)).all(axis=1).any())
