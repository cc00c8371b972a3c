"""Gravity on a table that is off level: the one place that says in which direction a tilt goes."""

from __future__ import annotations

import math

import numpy as np

from hw.dynamics import GRAVITY_M_S2
from hw.types import Array


def gravity_m_s2(left_up_rad: float, far_down_rad: float) -> Array:
    """(3,) gravity along the axes of a table that is turned about X (left side up), then about Y (far end down).

    Such a table rises by tan(left_up_rad) per metre along Y, and falls along X.
    """
    roll, pitch = left_up_rad, far_down_rad
    down = [math.sin(pitch), -math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch)]
    return GRAVITY_M_S2 * np.array(down)
