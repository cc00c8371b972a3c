"""The maker's limits of the three arms, joint by joint.

Sources: `control-parameters-joint-fer.csv`, `-fr3.csv` and `robot_specifications.rst`; the Panda's agree with
libfranka 0.9.2. The FR3 v2's positions, velocities and decelerations are published in `franka_description` (since
1.1.0) and equal the FR3's; of the two published velocity offsets of each joint, the row has the larger one, which
allows less. Its accelerations and jerks are published nowhere: those of the FR3 apply.

Velocities keep a margin for three lost packets of full acceleration, as libfranka does, because a controller that
misses packets extrapolates with the last acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hw.kinematics import JOINTS
from hw.types import PATH_RATE_HZ, Array, frozen_array

LOST_PACKETS = 3

DT_S = 1.0 / PATH_RATE_HZ

BEYOND_RAD = 0.05
"""No joint of an arm stands farther outside of its range: its stops are there. All joints 0 lie 0.07 rad outside of a
Panda's and 0.44 rad outside of an FR3's.
"""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """One arm's limits, each (7,). FR3 velocities shrink towards the position limits (`braking_*`)."""

    model: str
    q_min_rad: Array
    q_max_rad: Array
    dq_max_rad_s: Array
    ddq_max_rad_s2: Array
    dddq_max_rad_s3: Array
    braking_offset_rad_s: Array | None = None
    braking_rad_s2: Array | None = None

    def __post_init__(self) -> None:
        for name in ("q_min_rad", "q_max_rad", "dq_max_rad_s", "ddq_max_rad_s2", "dddq_max_rad_s3"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (JOINTS,), name))

    @property
    def plausible_rad(self) -> tuple[Array, Array]:
        """(7,) each: the least and the greatest joints that an arm of this model can report."""
        return self.q_min_rad - BEYOND_RAD, self.q_max_rad + BEYOND_RAD

    def require_plausible(self, q_rad: ArrayLike) -> None:
        """Reported joints (7,). Raises ValueError, naming a joint, for a posture that no arm of this model can have."""
        q = np.asarray(q_rad, dtype=np.float64)
        low, high = self.plausible_rad
        if ((q >= low) & (q <= high)).all():
            return
        i = int(np.argmax(np.maximum(low - q, q - high)))
        raise ValueError(
            f"joint {i + 1} at {q[i]:.4f} rad, its range is {self.q_min_rad[i]:.4f} to {self.q_max_rad[i]:.4f} rad"
        )

    def velocity_bounds(self, q_rad: Array) -> tuple[Array, Array]:
        """(..., 7) -> lowest and highest joint velocity (..., 7) there, with the margin for lost packets."""
        margin = LOST_PACKETS * DT_S * self.ddq_max_rad_s2
        high = np.broadcast_to(self.dq_max_rad_s, q_rad.shape)
        low = -high
        if self.braking_offset_rad_s is not None and self.braking_rad_s2 is not None:
            up = np.sqrt(np.maximum(2.0 * self.braking_rad_s2 * (self.q_max_rad - q_rad), 0.0))
            down = np.sqrt(np.maximum(2.0 * self.braking_rad_s2 * (q_rad - self.q_min_rad), 0.0))
            high = np.minimum(high, np.maximum(up - self.braking_offset_rad_s, 0.0))
            low = -np.minimum(-low, np.maximum(down - self.braking_offset_rad_s, 0.0))
        return np.minimum(low + margin, 0.0), np.maximum(high - margin, 0.0)

    def ratios(self, q_rad: Array, dq_rad_s: Array, ddq_rad_s2: Array) -> Array:
        """(..., 7) each -> (3, ..., 7): position (0 in the middle, 1 at a limit), velocity, acceleration."""
        middle, half = (self.q_max_rad + self.q_min_rad) / 2.0, (self.q_max_rad - self.q_min_rad) / 2.0
        low, high = self.velocity_bounds(q_rad)
        bound = np.where(dq_rad_s >= 0.0, high, -low)
        velocity = np.abs(dq_rad_s) / np.maximum(bound, 1e-9)
        return np.stack([np.abs(q_rad - middle) / half, velocity, np.abs(ddq_rad_s2) / self.ddq_max_rad_s2])


LIMITS: dict[str, JointLimits] = {
    "panda": JointLimits(
        "panda",
        q_min_rad=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        q_max_rad=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        dq_max_rad_s=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        ddq_max_rad_s2=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        dddq_max_rad_s3=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]),
    ),
    "fr3": JointLimits(
        "fr3",
        q_min_rad=np.array([-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508]),
        q_max_rad=np.array([2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508]),
        dq_max_rad_s=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
        ddq_max_rad_s2=np.full(7, 10.0),
        dddq_max_rad_s3=np.full(7, 5000.0),
        braking_offset_rad_s=np.array([0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628]),
        braking_rad_s2=np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
    ),
}
LIMITS["fr3v2"] = replace(
    LIMITS["fr3"],
    model="fr3v2",
    braking_offset_rad_s=np.array([0.6599, 0.2517, 0.2005, 0.3542, 0.5757, 0.4885, 0.4628]),
)


def derivatives(q_rad: Array) -> tuple[Array, Array, Array]:
    """1 kHz samples (N, ..., 7) -> velocity, acceleration, jerk (N + 3, ..., 7), at rest before and after them.

    Differences of the samples, as the arm sees them: a path that does not start or end at rest shows as jerk.
    """
    padded = np.concatenate([np.repeat(q_rad[:1], 3, axis=0), q_rad, np.repeat(q_rad[-1:], 3, axis=0)])
    dq = np.diff(padded, axis=0) / DT_S
    ddq = np.diff(dq, axis=0) / DT_S
    dddq = np.diff(ddq, axis=0) / DT_S
    return dq[2:], ddq[1:], dddq
