"""Limits of a motion as a whole: joint torques, and velocity and acceleration of the flange.

Torques are those of `hw.dynamics` with the load on the flange. They leave out the arm's friction. So paths may use only
`TORQUE_SHARE` of a joint's rating.

The maker states flange limits for motions commanded in Cartesian coordinates. Ours are commanded in joints, for which
the arm does not enforce them; they are kept as a sane bound. The elbow is joint 3: the maker's limits of the elbow are
those of that joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.collision import Table, Tool, point_heights
from hw.dynamics import Demand, demand_of
from hw.joint_limits import DT_S, JointLimits, derivatives
from hw.kinematics import JOINTS, jacobian, link_poses
from hw.limits import COLLISION_SHARE, Worst, worst
from hw.mass import Mass
from hw.types import Array, ContactWindow, JointPath, frozen_array

RATED_NM = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
"""Rated torques of the joints of all arms (the maker's `robot_specifications`)."""

TORQUE_SHARE = 0.9
TORQUE_RATE_NM_S = 1000.0
"""Largest torque rate of every joint of all arms (the same source)."""


@dataclass(frozen=True)
class FlangeLimits:
    """The flange's largest velocity, acceleration and jerk, in translation and rotation."""

    m_s: float
    m_s2: float
    m_s3: float
    rad_s: float
    rad_s2: float
    rad_s3: float


FLANGE = {
    "panda": FlangeLimits(1.7, 13.0, 6500.0, 2.5, 25.0, 12500.0),
    "fr3": FlangeLimits(3.0, 9.0, 4500.0, 2.5, 17.0, 8500.0),
    "fr3v2": FlangeLimits(3.0, 9.0, 4500.0, 2.5, 17.0, 8500.0),
}
"""The maker's Cartesian limits of each model; the maker states none for the FR3 v2, so it has those of the FR3."""


@dataclass(frozen=True)
class _Quantity:
    name: str
    where: str  # empty: the message names the joint
    values: Array  # (N, ..., 7) or (N, ...)
    limit: Array  # (7,) or ()
    unit: str

    @property
    def ratio(self) -> Array:
        return np.asarray(np.abs(self.values) / self.limit)


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """The limits of one arm with its load: of each joint, and of all joints together."""

    joints: JointLimits  # for the joints that the arm reports
    zeros_rad: Array  # (7,) true joints are those reported plus these
    load: Mass  # on the flange, hand included

    def __post_init__(self) -> None:
        object.__setattr__(self, "zeros_rad", frozen_array(self.zeros_rad, (JOINTS,), "joint zeros"))

    @property
    def model(self) -> str:
        """The arm's model, a key of `hw.joint_limits.LIMITS`."""
        return self.joints.model

    def ratio(self, q_rad: Array, dq_rad_s: Array, ddq_rad_s2: Array, step_s: float) -> Array:
        """Samples (N, ..., 7) along the first axis, `step_s` apart -> (...) the largest share of any limit."""
        demand = self._quantities(
            demand_of(self.model, q_rad + self.zeros_rad, dq_rad_s, ddq_rad_s2, self.load), step_s
        )
        lead = q_rad.shape[1:-1]
        largest = np.zeros(lead)
        for quantity in demand:
            ratio = quantity.ratio.max(axis=0)
            largest = np.maximum(largest, ratio.max(axis=-1) if ratio.shape != lead else ratio)
        return largest

    def checks(self, path: JointPath) -> list[Worst]:
        """Each quantity at its tightest moment along a path of reported joints."""
        dq, ddq, _ = derivatives(path.q_rad)
        q = np.concatenate([path.q_rad, np.repeat(path.q_rad[-1:], 3, axis=0)])
        t_s = np.asarray(np.arange(len(q)) * DT_S, dtype=np.float64)
        return [
            worst((one.name, one.unit), one.ratio, one.values, one.limit, t_s, one.where)
            for one in self._quantities(demand_of(self.model, q + self.zeros_rad, dq, ddq, self.load), DT_S)
        ]

    def _quantities(self, demand: Demand, step_s: float) -> list[_Quantity]:
        most, flange = FLANGE[self.model], "the flange"

        def rate(values: Array) -> Array:
            return np.asarray(np.diff(values, axis=0) / step_s)

        def size(values: Array) -> Array:
            return np.asarray(np.linalg.norm(values, axis=-1))

        def of_flange(name: str, values: Array, limit: float, unit: str) -> _Quantity:
            return _Quantity(name, flange, values, np.array(limit), unit)

        return [
            _Quantity("torque", "", demand.torque_Nm, TORQUE_SHARE * RATED_NM, "Nm"),
            _Quantity("torque rate", "", rate(demand.torque_Nm), np.full(JOINTS, TORQUE_RATE_NM_S), "Nm/s"),
            of_flange("travel speed", size(demand.flange_m_s), most.m_s, "m/s"),
            of_flange("travel acceleration", size(demand.flange_m_s2), most.m_s2, "m/s²"),
            of_flange("travel jerk", size(rate(demand.flange_m_s2)), most.m_s3, "m/s³"),
            of_flange("turning speed", size(demand.flange_rad_s), most.rad_s, "rad/s"),
            of_flange("turning acceleration", size(demand.flange_rad_s2), most.rad_s2, "rad/s²"),
            of_flange("turning jerk", size(rate(demand.flange_rad_s2)), most.rad_s3, "rad/s³"),
        ]


def contact_torque_check(path: JointPath, tool: Tool, table: Table, force_N: float, stops_at_Nm: Array) -> list[Worst]:
    """The joint torques of `force_N`, upwards on the tool's lowest point, along the window of a path of true joints.

    The arm takes torques from `stops_at_Nm` (7,) on for a collision. Empty without a window or points that may touch.
    """
    inside = _inside(path, path.contact)
    if not inside.any() or not len(tool.points_F_m):
        return []
    q_rad, t_s = path.q_rad[inside][::10], path.t_s[inside][::10]
    lowest = point_heights(link_poses(q_rad), tool, table).argmin(axis=1)
    torque_Nm = np.zeros((len(q_rad), JOINTS))
    for point in np.unique(lowest):
        at = lowest == point
        torque_Nm[at] = force_N * jacobian(q_rad[at], tool.points_F_m[point])[:, 2]
    limit_Nm = COLLISION_SHARE * stops_at_Nm
    return [worst(("predicted contact torque", "Nm"), np.abs(torque_Nm) / limit_Nm, torque_Nm, limit_Nm, t_s)]


def _inside(path: JointPath, window: ContactWindow | None) -> Array:
    if window is None:
        return np.zeros(len(path.t_s), dtype=bool)
    return np.asarray((path.t_s >= window.start_s - 1e-9) & (path.t_s <= window.end_s + 1e-9))
