"""What the hand holds, for the checks of `hw.limits`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import HAND, Tool
from hw.types import Array


def held(X_FT: Array, points_T_m: ArrayLike = ((0.0, 0.0, 0.0),), name: str = "tool") -> Tool:
    """The hand with a tool at X_FT (4, 4) whose points `points_T_m` (P, 3), in the tool frame, may touch the table."""
    points = np.atleast_2d(np.asarray(points_T_m, dtype=np.float64))
    return Tool(name, HAND, points @ X_FT[:3, :3].T + X_FT[:3, 3])
