"""A touch-off by hand: the places at which a person sets the tool down, with both corners of one end on the table.

There are seven places: the edge at five places around the work area, then the edge held steeply, then the heel. The
edge alone measures the table where it is needed, with whatever error the tool's assumed pose has; the other two turn
the tool about its edge, and so measure its pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hw.types import Array, frozen_array
from sim.panda.tool import Feeler

AROUND_M = ((-0.10, -0.16), (-0.10, 0.16), (0.06, 0.16), (0.06, -0.16), (-0.02, 0.0))
"""Places of the table around the work area's centre, along X and Y."""
HAND_M = 0.0003
"""Errors of a set-down by hand, one standard deviation each: that of both corners together, and that of each corner."""


@dataclass(frozen=True, eq=False)
class SetDown:
    """One end of the tool on the table, with both corners."""

    name: str
    how: str  # for the person
    corners: tuple[Feeler, Feeler]  # left, right
    xy_m: Array  # (2,) about where, in the table's frame
    pitch_rad: float  # about how the tool is held; positive: edge down
    pitches_rad: tuple[float, float]  # the range that counts as held so

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", frozen_array(self.xy_m, (2,), "xy_m"))


def set_downs(feelers: Sequence[Feeler], centre_m: ArrayLike) -> tuple[SetDown, ...]:
    """The places around `centre_m` (2,): `TABLE` at the table, then those for the tool."""
    centre = np.asarray(centre_m, dtype=np.float64)
    ahead = sorted(feelers, key=lambda f: -f.p_T_m[0])
    edge, heel = _pair(ahead[:2]), _pair(ahead[-2:])
    flat = tuple(
        _set_down(
            f"place {i}", "the edge on the table, the handle a little up", edge, centre + np.array(off), 10, 2, 18
        )
        for i, off in enumerate(AROUND_M, start=1)
    )
    steep = _set_down("steep", "the edge on the table, the handle steeply up", edge, centre, 24, 18, 45)
    back = _set_down("heel", "the rear end of the blade on the table, the edge up", heel, centre, -10, -30, -4)
    return (*flat, steep, back)


TABLE = len(AROUND_M)
"""Number of set-downs that measure the table."""


def middle(corners: tuple[Feeler, Feeler], X_FT: Array) -> Feeler:
    """The middle of an end of the tool at X_FT (4, 4), in the flange."""
    p_T_m = (corners[0].p_T_m + corners[1].p_T_m) / 2.0
    return Feeler("middle of the edge", X_FT[:3, :3] @ p_T_m + X_FT[:3, 3], corners[0].radius_m)


def pitch_rad(R_WT: Array) -> float:
    """Pitch of a tool with the orientation (3, 3) over a level table; positive: edge down."""
    return float(np.arcsin(np.clip(-R_WT[2, 0], -1.0, 1.0)))


def _pair(two: Sequence[Feeler]) -> tuple[Feeler, Feeler]:
    left, right = sorted(two, key=lambda f: -f.p_T_m[1])
    return left, right


def _set_down(
    name: str, how: str, corners: tuple[Feeler, Feeler], xy_m: Array, held: float, least: float, most: float
) -> SetDown:
    at, low, high = np.deg2rad([held, least, most]).tolist()
    return SetDown(name, how, corners, xy_m, at, (low, high))
