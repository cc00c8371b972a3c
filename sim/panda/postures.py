"""Postures for given flange poses and safe paths between them, to visit many poses in turn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import box_clearance, self_clearance, table_clearance
from hw.joint_limits import JointLimits
from hw.kinematics import link_poses
from hw.limits import Worst
from hw.types import Array, JointPath, frozen_array
from hw.workcell import Workcell
from sim.errors import NotExecutable
from sim.panda import model
from sim.panda.moves import join_paths, move_path

ROOM_M = 0.03
"""Least clearance of a posture; a path between postures may come as near as `hw.limits` allows."""

SPEED = 0.25
_USE = 0.9  # of the position limits
_Q7 = 61


def postures(X_BF: Array, cell: Workcell, q_near_rad: ArrayLike) -> list[Array | None]:
    """The posture (7,) nearest to `q_near_rad` that keeps the clearance, or None, for each flange pose (N, 4, 4)."""
    arm, true = cell.arm, cell.in_true_joints()
    limits, near = true.arm.limits, arm.true_rad(frozen_array(q_near_rad, (7,), "q_near_rad"))
    choices: list[Array | None] = []
    for X in X_BF:
        q = model.postures(X, limits, _Q7, _USE)
        q = q[_room(q, true)] if len(q) else q
        choices.append(arm.reported_rad(q[np.linalg.norm(q - near, axis=1).argmin()]) if len(q) else None)
    return choices


def nearest_first(q_rad: Array, q_start_rad: ArrayLike) -> list[int]:
    """An order for visiting postures (N, 7): always the nearest remaining one next."""
    left, here, order = list(range(len(q_rad))), np.asarray(q_start_rad), []
    while left:
        best = min(left, key=lambda i: float(np.abs(q_rad[i] - here).max()))
        order.append(best)
        left.remove(best)
        here = q_rad[best]
    return order


def way(q_from_rad: ArrayLike, q_to_rad: ArrayLike, q_home_rad: Array, cell: Workcell) -> JointPath:
    """A checked path: straight in joint space, else through home. Raises NotExecutable with the reason."""
    reason = ""
    for path in _ways(frozen_array(q_from_rad), frozen_array(q_to_rad), q_home_rad, cell.arm.limits):
        report = cell.check(path, q_from_rad)
        if report.ok:
            return path
        reason = _in_words(report.worst)
    raise NotExecutable(f"no path leads there: {reason}")


def _in_words(worst: Worst) -> str:
    """The reason why there is no way: two bodies that come too close, or another limit."""
    if worst.unit != "m" or worst.value > worst.limit:
        return str(worst)
    apart_mm, least_mm = 1e3 * worst.value, 1e3 * worst.limit
    if apart_mm < 0.0:
        return f"{worst.where} would overlap by {-apart_mm:.0f} mm"
    return f"{worst.where} would be {apart_mm:.1f} mm apart, and at least {least_mm:.0f} mm are needed"


def _ways(q_from: Array, q_to: Array, q_home: Array, limits: JointLimits) -> Iterator[JointPath]:
    yield move_path(q_from, q_to, limits, SPEED)
    if np.abs(q_from - q_home).max() > 1e-6 and np.abs(q_to - q_home).max() > 1e-6:
        yield join_paths(move_path(q_from, q_home, limits, SPEED), move_path(q_home, q_to, limits, SPEED))


def _room(q: Array, cell: Workcell) -> Array:
    """True joints (N, 7) -> (N,) whether each keeps `ROOM_M`."""
    poses, tool = link_poses(q), cell.tool
    clearances = [self_clearance(poses, tool)[0], table_clearance(poses, tool, cell.table)[0]]
    clearances += [box_clearance(poses, tool, box)[0] for box in cell.keep_out]
    return np.asarray(np.min([c.min(axis=1) for c in clearances], axis=0) > ROOM_M)
