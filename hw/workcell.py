"""The one value that defines where an arm may move, and the check of a motion against it.

Reported joint positions (which the arm reports and is commanded in) and true ones differ by the joint zeros. Every
`JointPath` holds reported joints. Joint limits apply to these, because the arm itself enforces them there. Geometry is
checked for the true ones, because that is where the arm is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hw.braking import check_braking
from hw.collision import KeepOut, Table, Tool
from hw.errors import ArmFault, MotionRefused
from hw.joint_limits import LIMITS, JointLimits
from hw.kinematics import JOINTS
from hw.limits import LimitReport, Worst, contact_checks, geometry_checks, joint_checks, refuse_beyond, start_check
from hw.motion_limits import MotionLimits, contact_torque_check
from hw.types import LARGEST_N, Array, JointPath, frozen_array, number

STOPS_AT_N = 80.0
"""The contact force at which an arm stops by itself: the default of `hw.franka.settings` and of the simulated lab."""


STOPS_AT_NM = (60.0, 60.0, 54.0, 54.0, 10.0, 10.0, 10.0)
"""The same for the torque on each joint."""


MOST_ZERO_RAD = 0.1
"""A joint whose zero is farther off has another fault."""


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The model of an arm, and the zeros of its joints."""

    limits: JointLimits  # of the reported joints
    zeros_rad: Array  # (7,) true joints minus reported joints

    def __post_init__(self) -> None:
        zeros_rad = frozen_array(self.zeros_rad, (JOINTS,), "joint zeros", most=MOST_ZERO_RAD)
        object.__setattr__(self, "zeros_rad", zeros_rad)

    @property
    def name(self) -> str:
        """A key of `hw.joint_limits.LIMITS`: "panda", "fr3" or "fr3v2"."""
        return self.limits.model

    def true_rad(self, q_rad: ArrayLike) -> Array:
        """Reported joints (..., 7) -> the true ones."""
        return np.asarray(np.asarray(q_rad, dtype=np.float64) + self.zeros_rad)

    def reported_rad(self, q_rad: ArrayLike) -> Array:
        """True joints (..., 7) -> the reported ones."""
        return np.asarray(np.asarray(q_rad, dtype=np.float64) - self.zeros_rad)

    def true(self, path: JointPath) -> JointPath:
        """A path in reported joints -> the same in true joints."""
        return replace(path, q_rad=self.true_rad(path.q_rad))

    def reported(self, path: JointPath) -> JointPath:
        """A path in true joints -> the same in reported joints."""
        return replace(path, q_rad=self.reported_rad(path.q_rad))

    def in_true_joints(self) -> ArmModel:
        """The same arm for planning in true joints: limits shifted by the zeros, zeros 0."""
        low_rad, high_rad = self.true_rad(self.limits.q_min_rad), self.true_rad(self.limits.q_max_rad)
        return ArmModel(replace(self.limits, q_min_rad=low_rad, q_max_rad=high_rad), np.zeros(JOINTS))


def arm_model(name: str, zeros_rad: ArrayLike) -> ArmModel:
    """The arm `name`, a key of `LIMITS`, with its joint zeros (7,). Raises ValueError for another name."""
    if name not in LIMITS:
        raise ValueError(f"arm {name!r} is not known: it must be one of {', '.join(LIMITS)}")
    return ArmModel(LIMITS[name], np.asarray(zeros_rad))


@dataclass(frozen=True, eq=False)
class Workcell:
    """Everything that decides whether a motion is allowed: arm, tool, surroundings."""

    arm: ArmModel
    tool: Tool
    table: Table  # the assumed table top
    keep_out: tuple[KeepOut, ...]
    stops_at_N: float  # the contact force along any axis at which this arm stops by itself
    stops_at_Nm: Array  # (7,) the same for the torque on each joint

    def __post_init__(self) -> None:
        object.__setattr__(self, "stops_at_Nm", frozen_array(self.stops_at_Nm, (JOINTS,), "stopping torques"))
        number(self.stops_at_N, "force at which the arm stops by itself", 0.0, LARGEST_N, "N", above=True)
        for stop_Nm in self.stops_at_Nm.tolist():
            number(stop_Nm, "torque at which the arm stops by itself", 0.0, LARGEST_N, "Nm", above=True)

    @property
    def motion(self) -> MotionLimits:
        """The motion limits of the arm with its tool."""
        return MotionLimits(self.arm.limits, self.arm.zeros_rad, self.tool.mass)

    def check(self, path: JointPath, q_now_rad: ArrayLike | None = None) -> LimitReport:
        """Check every limit: joints, torques, flange, rest at both ends, start, self-collision, boxes, table and
        contact.

        `q_now_rad` (7,) are the arm's present reported joints; without it the start is not checked.
        """
        start = [] if q_now_rad is None else [start_check(path, q_now_rad)]
        geometry = geometry_checks(self.arm.true(path), self.tool, self.table, self.keep_out)
        contact = [*contact_checks(path, self.tool, self.stops_at_N), *self.contact_torques(path)]
        joints = joint_checks(path, self.arm.limits)
        return LimitReport(self.arm.name, (*joints, *self.motion.checks(path), *start, *geometry, *contact))

    def contact_torques(self, path: JointPath, force_N: float | None = None) -> list[Worst]:
        """The joint torques of `force_N` (None: the force that `path` predicts). Empty without a contact."""
        if path.contact is None:
            return []
        felt_N = path.contact.force_N if force_N is None else force_N
        return contact_torque_check(self.arm.true(path), self.tool, self.table, felt_N, self.stops_at_Nm)

    def require(self, path: JointPath, q_now_rad: ArrayLike | None = None) -> LimitReport:
        """Do `check`, and also check that the arm can stop along the path at any time.

        Raises MotionRefused naming every broken limit.
        """
        report = self.check(path, q_now_rad)
        refuse_beyond(report)
        stops = check_braking(path, self.motion)
        if not stops.ok:
            late_s = float(stops.at_s[~np.isfinite(stops.duration_s)][0])
            raise MotionRefused(
                f"{self.arm.name}: no stop along the path from t = {late_s:.3f} s keeps the limits; slow it down"
            )
        return report

    def holding(self, tool: Tool) -> Workcell:
        """The same workcell with another tool on the flange."""
        return replace(self, tool=tool)

    def over(self, table: Table) -> Workcell:
        """The same workcell with another table top."""
        return replace(self, table=table)

    def in_true_joints(self) -> Workcell:
        """The same workcell for planning in true joints: a path passes it if its reported version passes `self`."""
        return replace(self, arm=self.arm.in_true_joints())


def refuse_while_stopped(fault: str | None) -> None:
    """Raises ArmFault while an arm is stopped by `fault`."""
    if fault is not None:
        raise ArmFault(f"the arm is stopped ({fault}); recover it before the next motion")


def refuse_unless_safe(path: JointPath, cell: Workcell, q_now_rad: Array, *, fault: str | None) -> None:
    """Raises ArmFault while stopped by `fault`, MotionRefused if `cell` refuses `path` from `q_now_rad` (7,)."""
    refuse_while_stopped(fault)
    cell.require(path, q_now_rad)
