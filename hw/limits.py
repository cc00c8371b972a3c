"""The limits of an arm, which `hw.workcell` checks over a whole path before anything moves.

Every check reports its tightest moment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import (
    KeepOut,
    Table,
    Tool,
    box_clearance,
    box_travel,
    point_heights,
    self_clearance,
    self_travel,
    table_clearance,
)
from hw.errors import MotionRefused
from hw.joint_limits import DT_S, JointLimits, derivatives
from hw.kinematics import JOINTS, link_poses
from hw.types import PATH_RATE_HZ, Array, JointPath, frozen_array

START_TOLERANCE_RAD = 0.01
REST_TOLERANCE_RAD_S = 0.01
SELF_CLEARANCE_M = 0.005
KEEP_OUT_CLEARANCE_M = 0.01
TABLE_CLEARANCE_M = 0.002
TOUCH_TOLERANCE_M = 0.0005
"""How deep a tool may be commanded below the table top outside a contact window, when it rests on the table."""
CONTACT_DEPTH_M = 0.006
"""The deepest window that a path may declare: a deeper one causes a reflex on a real arm."""
CONTACT_FORCE_N = 60.0
COLLISION_SHARE = 0.8
"""Share of an arm's own collision threshold that a predicted contact may use."""
GEOMETRY_STEP_S = 0.01
SAG_M = 0.0005
"""How much nearer two bodies may come within a `GEOMETRY_STEP_S` than if they moved on straight lines: at 13 m/s², 0.2
mm for each."""


@dataclass(frozen=True)
class Worst:
    """The tightest moment of one quantity. `ratio` above 1 breaks the limit."""

    quantity: str
    ratio: float
    where: str  # "joint 4", or the pair of bodies
    t_s: float
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.quantity} of {self.where} at t = {self.t_s:.3f} s is {self.value:.4g} {self.unit}, "
            f"limit {self.limit:.4g} {self.unit}"
        )


@dataclass(frozen=True)
class LimitReport:
    """All checks of one path, each at its tightest moment."""

    model: str
    checks: tuple[Worst, ...]

    @property
    def ok(self) -> bool:
        """Whether every check passed."""
        return all(check.ratio <= 1.0 for check in self.checks)

    @property
    def worst(self) -> Worst:
        """The check that comes closest to its limit."""
        return max(self.checks, key=lambda check: check.ratio)

    @property
    def joint_ratio(self) -> float:
        """The largest ratio among position, velocity, acceleration and jerk."""
        return max(check.ratio for check in self.checks if check.quantity in JOINT_QUANTITIES)


JOINT_QUANTITIES = ("position", "velocity", "acceleration", "jerk")


def joint_checks(path: JointPath, limits: JointLimits) -> list[Worst]:
    """Position, velocity, acceleration, jerk, and rest at both ends.

    Derivatives are differences of the 1 kHz samples, with rest before and after the path, as the arm sees it.
    """
    return [*_derivative_checks(path, limits), _rest(path)]


def start_check(path: JointPath, q_now_rad: ArrayLike) -> Worst:
    """Whether the path begins where the arm is now (7,)."""
    off = np.abs(path.q_rad[:1] - frozen_array(q_now_rad, (JOINTS,), "q_now_rad"))
    return worst(("distance from the arm", "rad"), off / START_TOLERANCE_RAD, off, START_TOLERANCE_RAD, path.t_s)


def refuse_beyond(report: LimitReport) -> None:
    """Raises MotionRefused naming every broken limit of a report, the worst first."""
    if not report.ok:
        broken = sorted((c for c in report.checks if c.ratio > 1.0), key=lambda c: -c.ratio)
        raise MotionRefused(
            f"{report.model}: " + "; ".join(map(str, broken)) + "; nothing has moved, plan another path"
        )


def _derivative_checks(path: JointPath, limits: JointLimits) -> list[Worst]:
    dq, ddq, dddq = derivatives(path.q_rad)
    q = np.concatenate([path.q_rad, np.repeat(path.q_rad[-1:], 3, axis=0)])
    t_s = np.concatenate([path.t_s, path.t_s[-1] + DT_S * np.arange(1, 4)])
    position, velocity, acceleration = limits.ratios(q, dq, ddq)
    nearest = np.where(q > (limits.q_min_rad + limits.q_max_rad) / 2.0, limits.q_max_rad, limits.q_min_rad)
    low, high = limits.velocity_bounds(q)
    return [
        worst(("position", "rad"), position, q, nearest, t_s),
        worst(("velocity", "rad/s"), velocity, dq, np.where(dq >= 0.0, high, low), t_s),
        worst(("acceleration", "rad/s²"), acceleration, ddq, limits.ddq_max_rad_s2, t_s),
        worst(("jerk", "rad/s³"), np.abs(dddq) / limits.dddq_max_rad_s3, dddq, limits.dddq_max_rad_s3, t_s),
    ]


def _rest(path: JointPath) -> Worst:
    """Velocity in the first and the last millisecond (the acceleration there is in the padded differences)."""
    ends = np.stack([path.q_rad[1] - path.q_rad[0], path.q_rad[-1] - path.q_rad[-2]]) / DT_S
    t_s = np.array([0.0, path.duration_s])
    return worst(("end velocity", "rad/s"), np.abs(ends) / REST_TOLERANCE_RAD_S, ends, REST_TOLERANCE_RAD_S, t_s)


def geometry_checks(path: JointPath, tool: Tool, table: Table, keep_out: tuple[KeepOut, ...]) -> list[Worst]:
    """Self-collision, table and boxes, for a path of true joints.

    Times between two samples count too: two bodies may be nearer there by half of their travel from one sample to the
    next. If that could break a limit, all samples of the path are checked.
    """
    pairs, over = partial(self_clearance, tool=tool), partial(table_clearance, tool=tool, table=table)
    checks = [
        _swept("self-collision", path, SELF_CLEARANCE_M, pairs, partial(self_travel, tool=tool)),
        _swept("table", path, TABLE_CLEARANCE_M, over, None),
    ]
    for box in keep_out:
        near = partial(box_clearance, tool=tool, box=box)
        checks.append(_swept("keep-out", path, KEEP_OUT_CLEARANCE_M, near, partial(box_travel, tool=tool)))
    if len(tool.points_F_m):
        checks.append(_depth(path, tool, table))
    return checks


def contact_limit_N(stops_at_N: float) -> float:
    """The largest contact force that a path may predict, for an arm that stops by itself at `stops_at_N`."""
    return min(CONTACT_FORCE_N, COLLISION_SHARE * stops_at_N)


def contact_checks(path: JointPath, tool: Tool, stops_at_N: float) -> list[Worst]:
    """The path's declared contact against the limits of any arm and of this one."""
    if path.contact is None:
        return []
    window = path.contact
    most_N = contact_limit_N(stops_at_N)
    return [
        Worst(what, value / limit, tool.name, window.start_s, value, limit, unit)
        for what, value, limit, unit in (
            ("declared contact depth", window.depth_m, CONTACT_DEPTH_M, "m"),
            ("predicted contact force", window.force_N, most_N, "N"),
        )
    ]


def _depth(path: JointPath, tool: Tool, table: Table) -> Worst:
    """The commanded depth of the tool's lowest point: at most the window's depth inside the window, and on the table
    outside it.
    """
    depth = -point_heights(link_poses(path.q_rad), tool, table).min(axis=1)
    allowed = np.full(len(depth), TOUCH_TOLERANCE_M)
    if path.contact is not None:
        inside = (path.t_s >= path.contact.start_s - 1e-9) & (path.t_s <= path.contact.end_s + 1e-9)
        allowed[inside] += path.contact.depth_m
    i = int(np.argmax(depth / allowed))
    ratio = max(float(depth[i] / allowed[i]), 0.0)
    return Worst("depth in the table", ratio, tool.name, float(path.t_s[i]), float(depth[i]), float(allowed[i]), "m")


Clearances = Callable[[Array], tuple[Array, tuple[str, ...]]]
"""Link poses (N, 9, 4, 4) -> clearances (N, P) and names."""
Travels = Callable[[Array], Array]
"""Link poses (N, 9, 4, 4) -> (N - 1, P): the most by which each clearance may shrink in a step."""


def _swept(quantity: str, path: JointPath, least_m: float, clearances: Clearances, travels: Travels | None) -> Worst:
    """The least clearance of a path, between its samples too.

    With `travels` None, only the change of a clearance itself bounds it between samples.
    """
    every, last = max(1, round(GEOMETRY_STEP_S * PATH_RATE_HZ)), len(path.t_s) - 1
    rows = np.unique(np.append(np.arange(0, last, every), last))
    near, names = _between(path, rows, clearances, travels)
    doubtful = np.flatnonzero(near.min(axis=1) < least_m + SAG_M)
    if len(doubtful):
        fine = np.unique(np.concatenate([np.arange(rows[i], rows[i + 1] + 1) for i in doubtful]))
        closer, _ = _between(path, fine, clearances, travels)
        closer[np.diff(fine) > 1] = np.inf  # between two stretches
        near[doubtful] = np.inf
        rows, near = np.concatenate([rows[:-1], fine[:-1]]), np.concatenate([near, closer])
    return _clearance(quantity, near, names, least_m, path.t_s[rows])


def _between(
    path: JointPath, rows: Array, clearances: Clearances, travels: Travels | None
) -> tuple[Array, tuple[str, ...]]:
    """(N - 1, P) lower bounds of the clearances between chosen samples (N,), and the names."""
    poses = link_poses(path.q_rad[rows])
    clearance, names = clearances(poses)
    travel = np.abs(np.diff(clearance, axis=0)) if travels is None else travels(poses)
    return (clearance[:-1] + clearance[1:] - travel) / 2.0, names


def _clearance(quantity: str, clearance: Array, names: tuple[str, ...], least_m: float, t_s: Array) -> Worst:
    i, j = np.unravel_index(int(np.argmin(clearance)), clearance.shape)
    value = float(clearance[i, j])
    return Worst(quantity, least_m / max(value, 1e-6), names[j], float(t_s[i]), value, least_m, "m")


def worst(what: tuple[str, str], ratio: Array, value: Array, limit: ArrayLike, t_s: Array, where: str = "") -> Worst:
    """The largest ratio of (n, 7), or of (n,) at `where`, as an entry; `what` is (quantity, unit)."""
    at = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    bound = float(np.broadcast_to(np.asarray(limit, dtype=np.float64), ratio.shape)[at])
    place = where or f"joint {at[1] + 1}"
    return Worst(what[0], float(ratio[at]), place, float(t_s[at[0]]), float(value[at]), bound, what[1])
