"""The bottle: found on its mark, tracked until it rests."""

from __future__ import annotations

from perception.arm_mask import Arm, Capsules, ToolMask
from perception.bottle.detection import BottleDetection, find_bottle
from perception.bottle.tracking import track_bottle
from perception.cylinder import Cylinder

__all__ = [
    "Arm",
    "BottleDetection",
    "Capsules",
    "Cylinder",
    "ToolMask",
    "find_bottle",
    "track_bottle",
]
