"""The bottle: found on its mark, tracked until it rests."""

from __future__ import annotations

from perception.bottle.detection import BottleDetection, find_bottle
from perception.bottle.tracking import track_bottle

__all__ = ["BottleDetection", "find_bottle", "track_bottle"]
