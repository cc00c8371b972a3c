"""The same path at a slower pace: to watch a new motion before it runs at full speed."""

from __future__ import annotations

import math

import numpy as np

from hw.braking import joint_spline
from hw.types import PATH_RATE_HZ, ContactWindow, JointPath, number

SLOWEST = 0.1
FULL = 1.0


def slowed(path: JointPath, pace: float) -> JointPath:
    """`path` in time stretched by 1 / `pace`, its contact window too. Raises ValueError for a pace not in 0.1 to 1.

    The result is a path as any other: whoever plays it checks every limit again.
    """
    number(pace, "pace", SLOWEST, FULL)
    if pace == FULL:
        return path
    t_s = np.arange(math.ceil(path.duration_s / pace * PATH_RATE_HZ) + 1) / PATH_RATE_HZ
    q_rad = joint_spline(path)(np.minimum(t_s * pace, path.duration_s))
    window = path.contact
    slow = None if window is None else _stretched(window, 1.0 / pace)
    return JointPath(t_s, q_rad, slow)


def _stretched(window: ContactWindow, by: float) -> ContactWindow:
    return ContactWindow(by * window.start_s, by * window.end_s, window.depth_m, window.force_N)
