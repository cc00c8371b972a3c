"""Slow ways down with the closed fingers, which touch the table lightly, without a planner."""

from __future__ import annotations

from functools import cache

import numpy as np
from cells import smooth
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from hw.collision import HAND_MASS, Tool
from hw.kinematics import forward
from hw.outline import COARSE_HAND, FINGERS, HAND
from hw.types import Array, ContactWindow, JointPath, frozen_array
from hw.wrist import FINGERTIP_M

TIP = frozen_array([0.0, 0.0, FINGERTIP_M])
TOOL = Tool("fingertips", HAND_MASS, HAND, np.array([TIP]), FINGERS, COARSE_HAND)
"""The empty hand whose fingers may touch the table."""
FORCE_N = 20.0
XY_M, TOP_M = (0.5, 0.0), 0.02
_NEAR = np.array([0.0, 0.25, 0.0, -2.3, 0.0, 2.55, np.pi / 4])


def over(height_m: float, q_near: Array = _NEAR) -> Array:
    """(7,) fingers straight down, their tips at `height_m` over the table."""

    def off(q: Array) -> Array:
        X = forward(q)
        tip = X[:3, :3] @ TIP + X[:3, 3]
        return np.concatenate([10.0 * (tip - [*XY_M, height_m]), X[:2, 2], [X[2, 2] + 1.0], 1e-3 * (q - q_near)])

    return np.asarray(least_squares(off, q_near, xtol=1e-14, ftol=1e-14, gtol=1e-14).x)


def tip_m(q_rad: ArrayLike) -> float:
    """The height of the fingertips, in the base."""
    X_BF = forward(q_rad)
    return float((X_BF[:3, :3] @ TIP + X_BF[:3, 3])[2])


Q_TOP_RAD = frozen_array(over(TOP_M))
Q_AWAY_RAD = frozen_array(Q_TOP_RAD + np.array([0.1, -0.1, 0.1, 0.0, 0.1, 0.1, 0.1]))
"""Where an arm felt its load before: a contact needs two postures."""


def approach() -> JointPath:
    """A free motion from `Q_AWAY_RAD` to `Q_TOP_RAD`."""
    t_s = np.arange(601) / 1000
    return JointPath(t_s, Q_AWAY_RAD + smooth(t_s / t_s[-1])[:, None] * (Q_TOP_RAD - Q_AWAY_RAD))


@cache
def down(way_m: float = 0.034, speed_m_s: float = 0.012) -> JointPath:
    """From 20 mm over the table straight down by `way_m`, at most at `speed_m_s`."""
    knots = np.linspace(0.0, way_m, 7)
    postures = [Q_TOP_RAD]
    for depth in knots[1:]:
        postures.append(over(TOP_M - depth, postures[-1]))
    duration_s = 2.1875 * way_m / speed_m_s
    t_s = np.arange(round(1000 * (duration_s + 0.25)) + 1) / 1000
    share = smooth(np.clip((t_s - 0.25) / duration_s, 0.0, 1.0))
    q_rad = CubicSpline(knots, np.array(postures))(way_m * share)
    q_rad[0] = q_rad[1] = Q_TOP_RAD
    return JointPath(t_s, q_rad, ContactWindow(0.0, float(t_s[-1]), 0.005, FORCE_N))
