"""The bottle: found on its mark, shown to the operator with its goal, tracked until it rests."""

from __future__ import annotations

from perception.arm_mask import Arm, Capsules
from perception.bottle.detection import BottleDetection, find_bottle
from perception.bottle.overlay import overlay
from perception.bottle.tracking import track_bottle
from perception.cylinder import Cylinder
from perception.geometry import Area
from perception.tool_mask import ToolMask

__all__ = [
    "Area",
    "Arm",
    "BottleDetection",
    "Capsules",
    "Cylinder",
    "ToolMask",
    "find_bottle",
    "overlay",
    "track_bottle",
]
