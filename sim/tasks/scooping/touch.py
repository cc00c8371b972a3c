"""The points of the blade that touch the table in a touch-off."""

from __future__ import annotations

import numpy as np

from perception.blade import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.panda.feelers import Feeler, Touchable
from sim.tasks.scooping.params import CORNER_M, EDGE_M

_SIDE_M = (BLADE_WIDTH_M - EDGE_M) / 2.0
_DOWN_M = -EDGE_M + CORNER_M

TOUCHABLE = Touchable(
    feelers=tuple(
        Feeler(f"{side} corner of the {end}", np.array([x_m, y_m, _DOWN_M]), CORNER_M)
        for end, x_m in (("edge", 0.0), ("heel", -BLADE_LENGTH_M))
        for side, y_m in (("left", _SIDE_M), ("right", -_SIDE_M))
    ),
    centre_m=(0.66, 0.0),
)
"""The blade's lower corners: two at its leading edge, two at its root."""
