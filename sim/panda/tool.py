"""What the hand holds, for the checks of `hw.limits`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import HAND, Capsule, Tool
from hw.kinematics import FLANGE
from hw.types import Array


def held(
    X_FT: Array,
    capsules_T: tuple[Capsule, ...] = (),
    points_T_m: ArrayLike = ((0.0, 0.0, 0.0),),
    name: str = "tool",
) -> Tool:
    """The hand with a tool at X_FT (4, 4).

    `capsules_T`, in the tool frame, must stay clear of arm, table and boxes; the points `points_T_m` (P, 3), in the
    tool frame too, may touch the table.
    """

    def in_flange(p_T_m: ArrayLike) -> Array:
        return np.asarray(np.asarray(p_T_m, dtype=np.float64) @ X_FT[:3, :3].T + X_FT[:3, 3])

    carried = (replace(c, link=FLANGE, start_m=in_flange(c.start_m), end_m=in_flange(c.end_m)) for c in capsules_T)
    return Tool(name, (*HAND, *carried), in_flange(np.atleast_2d(points_T_m)))
