"""The motion of the tool's carriage in a training rollout: forward, up and pitch, each by a spring and a damper.

An arm yields in all three at once, because a push upwards also rotates the tool and so moves it forward. But there is
one point, the centre of compliance, at which the three are independent, and the springs act there. They are part of
Drake's implicit solver.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hw.types import Array
from sim.types import ToolMotion

if TYPE_CHECKING:
    from pydrake.trajectories import PiecewisePolynomial

_KNOT_EVERY = 4  # samples of the motion between two knots of the drive


@dataclass(frozen=True)
class Compliance:
    """The compliance of the carriage in one vertical plane: springs, dampers and a mass about one point P.

    Positions are (x, z) along the axes of T. Stiffness and damping are forward, up (N/m, Ns/m) and pitch (Nm, Nms).
    """

    p_TP_m: tuple[float, float]  # the centre of compliance
    stiffness: tuple[float, float, float]
    damping: tuple[float, float, float]
    mass_kg: float
    p_PM_m: tuple[float, float]  # the centre of mass
    inertia_kg_m2: float  # about the centre of mass

    def yielding(self, pitch_rad: float) -> Array:
        """(3,) motion of P forward and up (m) and its pitch (rad) per newton that lifts the origin of T."""
        ahead_m = -(math.cos(pitch_rad) * self.p_TP_m[0] + math.sin(pitch_rad) * self.p_TP_m[1])
        return np.array([0.0, 1.0 / self.stiffness[1], -ahead_m / self.stiffness[2]])

    def tool_height(self, state: Array) -> tuple[float, float]:
        """Height of the origin of T (m) and its rate (m/s), with the carriage at `state` (6,)."""
        (x_m, z_m), pitch_rad, rate_rad_s = self.p_TP_m, state[2], state[5]
        cos, sin = math.cos(pitch_rad), math.sin(pitch_rad)
        return float(state[1] + sin * x_m - cos * z_m), float(state[4] + rate_rad_s * (cos * x_m + sin * z_m))

    def lift_m_N(self, pitch_rad: float) -> float:
        """Rise of the origin of T per newton that lifts it, m/N."""
        _, up, turn = self.yielding(pitch_rad)
        return float(up + turn**2 * self.stiffness[2])


@dataclass(frozen=True, eq=False)
class Drive:
    """A motion of the carriage in one vertical plane."""

    X_BP: Array  # (4, 4) X along the plane at table height, Z up; its origin is the plane's nearest to that of B
    trajectory: PiecewisePolynomial  # (6,) forward, up and pitch of the centre of compliance, and their rates
    compliance: Compliance


def drive_of(motion: ToolMotion, compliance: Compliance) -> Drive:
    """The drive of a motion whose tool stays in one vertical plane, linear between knots."""
    from pydrake.trajectories import PiecewisePolynomial  # noqa: PLC0415 - slow to import, and tasks are named without

    X_BT = motion.X_BT
    left = X_BT[0, :2, 1]
    ahead = np.array([left[1], -left[0]])
    X_BP = np.eye(4)
    X_BP[:2, 0], X_BP[:2, 1], X_BP[:2, 3] = ahead, left, (left @ X_BT[0, :2, 3]) * left
    cos, sin = X_BT[:, :2, 0] @ ahead, X_BT[:, :2, 2] @ ahead
    x_m, z_m = compliance.p_TP_m
    q = np.stack(
        [
            X_BT[:, :2, 3] @ ahead + (cos * x_m + sin * z_m),
            X_BT[:, 2, 3] + (cos * z_m - sin * x_m),
            np.arctan2(sin, cos),
        ]
    )
    rates = np.gradient(q, motion.t_s, axis=1)
    knots = slice(None, None, _KNOT_EVERY)
    trajectory = PiecewisePolynomial.FirstOrderHold(motion.t_s[knots], np.concatenate([q, rates])[:, knots])
    return Drive(X_BP, trajectory, compliance)
