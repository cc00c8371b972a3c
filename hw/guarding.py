"""Limits of a guarded motion: slow, tool first, and weak enough that the arm never stops itself.

A guarded motion searches for the table, so it may be commanded deeper than any other motion; it ends at the force.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hw.braking import check_braking
from hw.collision import Table, Tool, point_heights, table_clearance
from hw.errors import MotionRefused
from hw.kinematics import forward, link_poses
from hw.limits import LimitReport, Worst, contact_limit_N, refuse_beyond
from hw.types import PATH_RATE_HZ, Array, Guard, JointPath
from hw.workcell import Workcell

SPEED_M_S = 0.020
DEPTH_M = 0.035
"""How far below the assumed table a guarded motion may search."""
LEAD_M = 0.002
"""How much lower the tool's points must be than the rest of arm and tool during the search."""
GUARD_SHARE = 0.5
"""Largest force of the guard, as a share of the arm's own collision threshold."""


def check_guarded(path: JointPath, guard: Guard, cell: Workcell, q_now_rad: ArrayLike | None = None) -> LimitReport:
    """`Workcell.check` with other rules for the table: speed, depth of the search, tool first, forces."""
    plain = cell.check(JointPath(path.t_s, path.q_rad), q_now_rad)
    checks = [check for check in plain.checks if check.quantity not in ("table", "depth in the table")]
    force_N = guard.force_N if path.contact is None else max(path.contact.force_N, guard.force_N)
    true = cell.arm.true(path)
    checks += [
        _speed(true, guard),
        *_search(true, cell.tool, cell.table),
        *cell.contact_torques(path, guard.force_N),
        _plain("guard's force", cell.tool, guard.force_N, GUARD_SHARE * cell.stops_at_N),
        _plain("predicted contact force", cell.tool, force_N, contact_limit_N(cell.stops_at_N)),
    ]
    return LimitReport(cell.arm.name, tuple(checks))


def require_guarded(path: JointPath, guard: Guard, cell: Workcell, q_now_rad: ArrayLike | None = None) -> LimitReport:
    """`check_guarded`, a declared window, and a stop along the path at any time. Raises MotionRefused."""
    model = cell.arm.name
    if path.contact is None or not len(cell.tool.points_F_m):
        raise MotionRefused(
            f"{model}: a guarded motion declares where it may touch and with which points of the tool; this path "
            f"{'has no contact window' if path.contact is None else 'is of a tool without such points'}, nothing moved"
        )
    report = check_guarded(path, guard, cell, q_now_rad)
    refuse_beyond(report)
    if not check_braking(path, cell.motion).ok:
        raise MotionRefused(f"{model}: at some moments this guarded motion cannot stop within the limits; slow it down")
    return report


def withdrawal(braked: JointPath) -> JointPath:
    """The way back to the start of a path that was braked to rest: its samples in reverse."""
    return JointPath(braked.t_s, braked.q_rad[::-1])


def _speed(path: JointPath, guard: Guard) -> Worst:
    X_BF = forward(path.q_rad)
    p_m = X_BF[:, :3, :3] @ guard.p_F_m + X_BF[:, :3, 3]
    speed = np.linalg.norm(np.diff(p_m, axis=0), axis=1) * PATH_RATE_HZ
    i = int(np.argmax(speed))
    value = float(speed[i])
    return Worst("speed", value / SPEED_M_S, "the guarded point", i / PATH_RATE_HZ, value, SPEED_M_S, "m/s")


def _search(path: JointPath, tool: Tool, table: Table) -> list[Worst]:
    """The depth of the search, and whether the tool's points stay lowest all the way."""
    poses = link_poses(path.q_rad[:: round(0.01 * PATH_RATE_HZ)])
    lowest: Array = point_heights(poses, tool, table).min(axis=1)
    others, names = table_clearance(poses, tool, table)
    lead = others - lowest[:, None]
    i, j = np.unravel_index(int(np.argmin(lead)), lead.shape)
    least_m, who = float(lead[i, j]), names[j].replace(" and table", " over the tool")
    deep = int(np.argmin(lowest))
    deep_m = float(-lowest[deep])
    return [
        Worst("depth of the search", max(deep_m, 0.0) / DEPTH_M, tool.name, 0.01 * deep, deep_m, DEPTH_M, "m"),
        Worst("lead", LEAD_M / max(least_m, 1e-6), who, 0.01 * float(i), least_m, LEAD_M, "m"),
    ]


def _plain(quantity: str, tool: Tool, value: float, limit: float) -> Worst:
    return Worst(quantity, value / limit, tool.name, 0.0, value, limit, "N")
