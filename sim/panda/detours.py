"""Free motions around obstacles: straight in joint space, else through other postures.

A way is a polyline in joint space. The arm rests at every corner, so each piece is an ordinary move. The corners come
from a fixed set of clear postures. The shortest way through them is searched, and a piece is checked only when it is
about to be used (a lazy probabilistic roadmap, Bohlin and Kavraki 2000).
"""

from __future__ import annotations

import heapq
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import box_clearance, point_heights, self_clearance, table_clearance
from hw.joint_limits import LIMITS
from hw.kinematics import link_poses
from hw.limits import KEEP_OUT_CLEARANCE_M, SELF_CLEARANCE_M, TABLE_CLEARANCE_M
from hw.types import Array, JointPath, frozen_array
from hw.workcell import Workcell
from sim.errors import NotExecutable
from sim.panda.moves import join_paths, move_path

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
    corners = _Space(cell).way(q_from, q_to)
    if corners is not None:
        path = join_paths(*(move_path(a, b, limits, speed) for a, b in pairwise(corners)))
        around = cell.check(path, q_from)
        if around.ok:
            return path
        report = around
    raise NotExecutable(f"{model}: no way around: {report.worst}; clear the workspace or choose another posture")


class _Space:
    """The free space of one scene, checked piece by piece."""

    def __init__(self, cell: Workcell) -> None:
        self._cell = cell

    def way(self, q_from: Array, q_to: Array) -> list[Array] | None:
        """The corners of a free way, ends included; None if the roadmap has no way."""
        vias = _postures(self._cell.arm.name)
        nodes = np.concatenate([[q_from, q_to], vias[self._clear(vias, ROOM_M, TIP_M)]])
        ways = _neighbours(nodes)
        known: dict[tuple[int, int], bool] = {}
        while (found := _shortest(ways)) is not None:
            for a, b in pairwise(found):
                key = (min(a, b), max(a, b))
                if key not in known:
                    known[key] = self._piece(nodes[a], nodes[b])
                if not known[key]:
                    del ways[a][b], ways[b][a]
                    break
            else:
                return self._shortened([nodes[i] for i in found])
        return None

    def _shortened(self, corners: list[Array]) -> list[Array]:
        """The corners without superfluous ones."""
        at = 0
        while at < len(corners) - 2:
            last = len(corners) - 1
            while last > at + 1 and not self._piece(corners[at], corners[last]):
                last -= 1
            corners = [*corners[: at + 1], *corners[last:]]
            at += 1
        return corners

    def _piece(self, a: Array, b: Array) -> bool:
        """Whether the straight piece is free; at its ends it may be as near as `hw.limits` allows, not nearer."""
        count = max(2, int(np.ceil(np.abs(b - a).max() / STEP_RAD)) + 1)
        return bool(self._clear(np.linspace(a, b, count), _SLIM_M, 0.0).all())

    def _clear(self, q_rad: Array, room_m: float, tip_m: float) -> Array:
        """Postures (N, 7) -> (N,) whether each keeps its distance from itself, the table and the boxes."""
        cell = self._cell
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
    """For each node its nearest neighbours, symmetric; the two ends have more neighbours."""
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
