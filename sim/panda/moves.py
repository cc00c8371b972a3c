"""Joint paths from one posture to another: smooth in time, at rest at both ends."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import box_clearance, point_heights, self_clearance, table_clearance
from hw.joint_limits import LIMITS, JointLimits, derivatives
from hw.kinematics import link_poses
from hw.limits import KEEP_OUT_CLEARANCE_M, SELF_CLEARANCE_M, TABLE_CLEARANCE_M
from hw.types import PATH_RATE_HZ, Array, JointPath, frozen_array
from hw.workcell import Workcell
from sim.errors import NotExecutable

PEAK_SPEED, PEAK_ACCELERATION, PEAK_JERK = 2.1875, 7.5132, 52.5
"""Largest derivatives of `smooth_step` over unit time."""

MOVE_RATIO = 0.95
"""Largest share of a joint's limits that a move uses."""

Along = Callable[[Array], Array]

_STRETCH = 1.25
_TRIES = 16


def smooth_step(u: Array) -> Array:
    """0 to 1 while u goes from 0 to 1, with velocity, acceleration and jerk zero at both ends (seventh order)."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))


def move_path(q_from_rad: ArrayLike, q_to_rad: ArrayLike, limits: JointLimits, speed: float = 0.3) -> JointPath:
    """Move all joints together from one posture (7,) to another (7,), at `speed` times the fastest possible.

    Raises NotExecutable if an end lies outside the position limits.
    """
    q_from, q_to = frozen_array(q_from_rad, (7,), "q_from_rad"), frozen_array(q_to_rad, (7,), "q_to_rad")
    distance = np.abs(q_to - q_from)
    fastest_s = max(
        PEAK_SPEED * (distance / limits.dq_max_rad_s).max(),
        np.sqrt(PEAK_ACCELERATION * (distance / limits.ddq_max_rad_s2).max()),
        np.cbrt(PEAK_JERK * (distance / limits.dddq_max_rad_s3).max()),
    )

    def along(share: Array) -> Array:
        return np.asarray(q_from + share[:, None] * (q_to - q_from))

    return time_curve(along, max(fastest_s / speed, 0.05), limits)


def time_curve(along: Along, duration_s: float, limits: JointLimits) -> JointPath:
    """The path along the joint curve `along` (share (N,) of the way -> (N, 7)), in `duration_s` or slower if the limits
    require it.

    Raises NotExecutable near a position limit or a singularity, where a slower motion does not help either.
    """
    held = along(np.linspace(0.0, 1.0, 101))
    still = np.zeros_like(held)
    place = float(limits.ratios(held, still, still)[0].max())
    for _ in range(_TRIES if place <= MOVE_RATIO else 0):
        t_s = np.arange(round(duration_s * PATH_RATE_HZ) + 1) / PATH_RATE_HZ
        q_rad = along(smooth_step(t_s / t_s[-1]))
        if _ratio(q_rad, limits) <= MOVE_RATIO:
            return JointPath(t_s, q_rad)
        duration_s *= _STRETCH
    raise NotExecutable(
        f"{limits.model}: a move comes to {place:.2f} of a joint's position limits (largest allowed {MOVE_RATIO:g}), "
        "or breaks a limit of speed even when it is slow; choose other end postures"
    )


def join_paths(*paths: JointPath) -> JointPath:
    """Paths in sequence; each starts where the previous one rests. They must have no contact windows."""
    for before, after in pairwise(paths):
        if np.abs(after.q_rad[0] - before.q_rad[-1]).max() > 1e-9 or before.contact or after.contact:
            raise ValueError("paths can be joined only at rest, in the same posture and away from contact")
    q_rad = np.concatenate([paths[0].q_rad, *(p.q_rad[1:] for p in paths[1:])])
    return JointPath(np.arange(len(q_rad)) / PATH_RATE_HZ, q_rad)


def _ratio(q_rad: Array, limits: JointLimits) -> float:
    dq, ddq, dddq = derivatives(q_rad)
    q = np.concatenate([q_rad, np.repeat(q_rad[-1:], len(dq) - len(q_rad), axis=0)])
    return float(max(limits.ratios(q, dq, ddq).max(), (np.abs(dddq) / limits.dddq_max_rad_s3).max()))


SPEED = 0.25
ROOM_M = 0.02
"""Extra clearance of the corners (m), beyond that of `hw.limits`."""
TIP_M = 0.05
"""Least height of the tool's points over the table at the corners."""
STEP_RAD = 0.04
"""Resolution for checking a piece."""

_VIAS = 600
_NEIGHBOURS = 12
_SLIM_M = 0.001
_LOW_RAD = np.array([-2.4, -1.5, -1.2, -2.9, -1.5, 0.3, -2.5])
_HIGH_RAD = np.array([2.4, 0.9, 1.2, -0.6, 1.5, 3.2, 2.5])
_USE = 0.85  # of the position limits, for corners
_WEIGHTS = np.array([1.0, 1.0, 0.8, 0.8, 0.4, 0.4, 0.3])  # room swept by a rotation of each joint


def free_path(q_from_rad: ArrayLike, q_to_rad: ArrayLike, cell: Workcell, speed: float = SPEED) -> JointPath:
    """A checked path from one posture (7,) to another that keeps clear of arm, table and boxes.

    Deterministic. Raises NotExecutable naming the obstacle.
    """
    q_from, q_to = frozen_array(q_from_rad, (7,), "q_from_rad"), frozen_array(q_to_rad, (7,), "q_to_rad")
    limits, model = cell.arm.limits, cell.arm.name
    straight = move_path(q_from, q_to, limits, speed)
    report = cell.check(straight, q_from)
    if report.ok:
        return straight
    for name, q in (("at the start of its way", q_from), ("at the end of its way", q_to)):
        still = cell.check(JointPath(np.array([0.0, 1e-3]), np.stack([q, q])))
        if not still.ok:
            raise NotExecutable(f"{model}: the arm is not clear {name}: {still.worst}; choose another posture")
    corners = _way(q_from, q_to, cell)
    if corners is not None:
        path = join_paths(*(move_path(a, b, limits, speed) for a, b in pairwise(corners)))
        around = cell.check(path, q_from)
        if around.ok:
            return path
        report = around
    raise NotExecutable(f"{model}: no way around: {report.worst}; clear the workspace or choose another posture")


def _way(q_from: Array, q_to: Array, cell: Workcell) -> list[Array] | None:
    """The corners of a free way, ends included; None if the roadmap has no way."""
    vias = _postures(cell.arm.name)
    nodes = np.concatenate([[q_from, q_to], vias[_clear(vias, cell, ROOM_M, TIP_M)]])
    ways = _neighbours(nodes)
    free: dict[tuple[int, int], bool] = {}
    while (route := _shortest(ways)) is not None:
        for a, b in pairwise(route):
            key = (min(a, b), max(a, b))
            if key not in free:
                free[key] = _piece(nodes[a], nodes[b], cell)
            if not free[key]:
                del ways[a][b], ways[b][a]
                break
        else:
            return _shortened([nodes[i] for i in route], cell)
    return None


def _shortened(corners: list[Array], cell: Workcell) -> list[Array]:
    """The corners without superfluous ones."""
    at = 0
    while at < len(corners) - 2:
        last = len(corners) - 1
        while last > at + 1 and not _piece(corners[at], corners[last], cell):
            last -= 1
        corners = [*corners[: at + 1], *corners[last:]]
        at += 1
    return corners


def _piece(a: Array, b: Array, cell: Workcell) -> bool:
    """Whether the straight piece is free; at its ends it may be as near as `hw.limits` allows, not nearer."""
    count = max(2, int(np.ceil(np.abs(b - a).max() / STEP_RAD)) + 1)
    return bool(_clear(np.linspace(a, b, count), cell, _SLIM_M, 0.0).all())


def _clear(q_rad: Array, cell: Workcell, room_m: float, tip_m: float) -> Array:
    """Postures (N, 7) -> (N,) whether each keeps its distance from itself, the table and the boxes."""
    tool, poses = cell.tool, link_poses(cell.arm.true_rad(q_rad))
    free = np.asarray(self_clearance(poses, tool)[0].min(axis=1) > SELF_CLEARANCE_M + _SLIM_M)
    free &= table_clearance(poses, tool, cell.table)[0].min(axis=1) > TABLE_CLEARANCE_M + room_m
    for box in cell.keep_out:
        free &= box_clearance(poses, tool, box)[0].min(axis=1) > KEEP_OUT_CLEARANCE_M + room_m
    if len(tool.points_F_m):
        free &= point_heights(poses, tool, cell.table).min(axis=1) >= tip_m
    return free


@lru_cache(maxsize=2)
def _postures(model: str) -> Array:
    """(N, 7) the fixed set of corners: spread evenly over the joints' ranges, elbow up and wrist forward."""
    from scipy.stats import qmc  # noqa: PLC0415 - slow to import, and rarely needed

    limits = LIMITS[model]
    middle, half = (limits.q_max_rad + limits.q_min_rad) / 2.0, (limits.q_max_rad - limits.q_min_rad) / 2.0
    low, high = np.maximum(middle - _USE * half, _LOW_RAD), np.minimum(middle + _USE * half, _HIGH_RAD)
    unit = qmc.Halton(7, scramble=False).random(_VIAS + 1)[1:]
    return frozen_array(low + unit * (high - low))


def _neighbours(nodes: Array) -> list[dict[int, float]]:
    """The nearest neighbours of each node, symmetric; the two ends have more neighbours."""
    apart = np.abs((nodes[:, None] - nodes[None]) * _WEIGHTS).max(axis=-1)
    ways: list[dict[int, float]] = [{} for _ in nodes]
    for a, row in enumerate(apart):
        for b in np.argsort(row)[1 : 1 + _NEIGHBOURS * (4 if a < 2 else 1)]:
            ways[a][int(b)] = ways[int(b)][a] = float(row[b])
    return ways


def _shortest(ways: list[dict[int, float]]) -> list[int] | None:
    """The shortest way from node 0 to node 1 (Dijkstra), or None."""
    best: dict[int, float] = {0: 0.0}
    before: dict[int, int] = {}
    queue = [(0.0, 0)]
    while queue:
        length, a = heapq.heappop(queue)
        if a == 1:
            chain = [1]
            while chain[-1] != 0:
                chain.append(before[chain[-1]])
            return chain[::-1]
        if length > best[a]:
            continue
        for b, step in ways[a].items():
            if length + step < best.get(b, np.inf):
                best[b], before[b] = length + step, a
                heapq.heappush(queue, (best[b], b))
    return None
