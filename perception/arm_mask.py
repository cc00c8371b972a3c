"""Which points of a depth image belong to the arm, by its own kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array, frozen_array
from perception.scan import Mask
from perception.tool_mask import ToolMask

_ARM_SLACK_M = 0.025  # capsules follow the arm roughly
_TOOL_SLACK_M = 0.009  # the tool's mesh is exact; this covers the camera's error


@dataclass(frozen=True, eq=False)
class Capsules:
    """All points within `radii_m` of segments."""

    ends_m: Array  # (C, 2, 3) in the base frame
    radii_m: Array  # (C,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "ends_m", frozen_array(self.ends_m, (None, 2, 3), "ends of the capsules"))
        object.__setattr__(self, "radii_m", frozen_array(self.radii_m, (len(self.ends_m),), "radii of the capsules"))

    def hold(self, points_m: Array, slack_m: float) -> Mask:
        """(n,) whether points (n, 3) lie in a capsule, or within `slack_m` of one."""
        held = np.zeros(len(points_m), dtype=bool)
        for (start, end), radius_m in zip(self.ends_m, self.radii_m, strict=True):
            reach = radius_m + slack_m
            low, high = np.minimum(start, end) - reach, np.maximum(start, end) + reach
            near = np.flatnonzero(~held & ((points_m > low) & (points_m < high)).all(axis=1))
            axis, arm = end - start, points_m[near] - start
            along = np.clip(arm @ axis / max(float(axis @ axis), 1e-18), 0.0, 1.0)
            gap = arm - along[:, None] * axis
            held[near] = np.einsum("ni,ni->n", gap, gap) < reach**2
        return held


NOTHING = Capsules(np.zeros((0, 2, 3)), np.zeros(0))
"""The capsules of an arm outside the picture: none."""


@dataclass(frozen=True, eq=False)
class Arm:
    """Arm and tool at one moment."""

    capsules: Capsules = NOTHING
    tool: ToolMask | None = None
    X_BT: Array | None = None

    def holds(self, points_m: Array) -> Mask:
        """(n,) whether points (n, 3) of the base frame are arm or tool."""
        held = self.capsules.hold(points_m, _ARM_SLACK_M)
        if self.tool is not None and self.X_BT is not None and len(points_m):
            rest = np.flatnonzero(~held)
            if len(rest):
                held[rest] = self.tool.near(self.X_BT, points_m[rest], _TOOL_SLACK_M)
        return held


NO_ARM = Arm()
"""An arm outside the picture, or too high to matter."""
