"""From a tool motion to the three joint paths of a trial: approach, task, retreat.

The task path follows the tool motion exactly (closed-form inverse kinematics); the remaining freedom keeps the arm away
from its limits (`sim.panda.redundancy`). Everything is checked by the `Workcell` before it is returned.

Postures and paths at the interface are in reported joints. Internally, planning uses true joints, for which the
geometry holds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import pairwise, product
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hw.collision import point_heights
from hw.joint_limits import DT_S
from hw.kinematics import forward, link_poses
from hw.limits import LimitReport
from hw.types import Array, JointPath, frozen_array
from hw.workcell import ArmModel, Workcell
from sim.errors import NotExecutable
from sim.panda.carrying import carry_path
from sim.panda.model import inverse, postures
from sim.panda.moves import free_path, join_paths, move_path, time_curve
from sim.panda.redundancy import ALLOWED, GOOD_ENOUGH, profiles
from sim.types import ToolMotion

LIFTS_M = (0.08, 0.16, 0.24)
"""Heights (m) over which the tool arrives and leaves vertically; the first that works is used."""

CLEAR_M = 0.05
"""Least height of the tool above the table during other motions."""

HOME_TOOL_M = ((0.45, 0.50, 0.55, 0.60), (0.0,), (0.25, 0.30, 0.35))
"""Places X, Y, Z of the tool at home: above the near side, so that a camera opposite sees the whole work area."""

VERTICAL_M_S = 0.08
MOVE_SPEED = 0.3

TUCKED_RAD = ((-0.5, -2.2), (-0.9, -2.4), (-1.2, -2.0))
"""Joints 2 and 4 of an arm drawn back, high above the table: the detour if the straight way home is blocked."""

_RISE_SWING_RAD = 0.8


def home(X_FT: Array, cell: Workcell, pitch_rad: float = 0.0) -> Array:
    """(7,) the posture between trials: the tool at a place of `HOME_TOOL_M`, the joints near the middle of their
    ranges.

    Raises NotExecutable if the tool cannot be held there.
    """
    true = cell.in_true_joints()
    limits = true.arm.limits
    places = np.array(list(product(*HOME_TOOL_M)))
    X_BT = np.tile(np.eye(4), (len(places), 1, 1))
    X_BT[:, :3, :3] = Rotation.from_euler("y", pitch_rad).as_matrix()
    X_BT[:, :3, 3] = places
    q = postures(X_BT @ np.linalg.inv(X_FT), limits, 91)
    worst = limits.ratios(q, np.zeros_like(q), np.zeros_like(q))[0].max(axis=1)
    for i in np.argsort(worst):
        still = JointPath(np.array([0.0, DT_S]), np.stack([q[i], q[i]]))
        if worst[i] > ALLOWED:
            break
        if true.check(still).ok:
            return frozen_array(cell.arm.reported_rad(q[i]))
    raise NotExecutable(f"{cell.arm.name}: the tool cannot be held at any of {HOME_TOOL_M} m; mount it differently")


def trial_paths(
    motion: ToolMotion, X_FT: Array, cell: Workcell, q_home: ArrayLike, *, carries: bool = False
) -> tuple[JointPath, JointPath, JointPath]:
    """Approach (home, above the start, straight down), task, and retreat (straight up, home), each checked.

    The retreat begins where the task path ends: the arm holds still there for as long as the operator likes. The tool
    stays `CLEAR_M` above the table except on the vertical stretches. If the direct way home is blocked, it goes around
    the obstacle. A tool that `carries` an object returns so gently that it keeps the object, if any posture allows
    that. Raises NotExecutable.
    """
    true, home_rad = cell.in_true_joints(), cell.arm.true_rad(frozen_array(q_home, (7,), "q_home"))
    gently: Ways | None = partial(_gently, q_home=home_rad, X_FT=X_FT, arm=true.arm) if carries else None
    freely: Ways = partial(_ways, q_home=home_rad, cell=true)
    best: tuple[float, Paths] | None = None
    unsteady: list[tuple[float, JointPath]] = []  # without a gentle way back: used only if every path is like that
    refused: NotExecutable | None = None
    for ratio, task in task_paths(motion, X_FT, true, home_rad):
        if best is not None and ratio >= best[0]:
            continue
        back = None if gently is None else _unless_refused(task.q_rad[-1], gently, true)
        if gently is not None and back is None:
            unsteady.append((ratio, task))
            continue
        try:
            best = ratio, _with_ways(task, freely, true, back)
        except NotExecutable as error:
            refused = error
            continue
        if ratio < GOOD_ENOUGH:
            break
    for ratio, task in sorted(unsteady, key=itemgetter(0)):
        if best is not None:
            break
        try:
            best = ratio, _with_ways(task, freely, true)
        except NotExecutable as error:
            refused = error
    if best is None:
        raise refused or NotExecutable(f"{cell.arm.name}: no task path; choose another action")
    approach, task, back = (cell.arm.reported(path) for path in best[1])
    return approach, task, back


Paths = tuple[JointPath, JointPath, JointPath]


def _with_ways(task: JointPath, ways: Ways, cell: Workcell, back: JointPath | None = None) -> Paths:
    """Approach, task and retreat (`back` if given). Raises NotExecutable."""
    away = _homeward(task.q_rad[0], ways, cell)
    return JointPath(away.t_s, away.q_rad[::-1]), task, back or _homeward(task.q_rad[-1], ways, cell)


def task_paths(
    motion: ToolMotion, X_FT: Array, cell: Workcell, seed: Array | None
) -> Iterator[tuple[float, JointPath]]:
    """Acceptable paths of true joints, computed one by one, each with the ratio that ranks it. Raises NotExecutable if
    there is none.

    `cell` is in true joints, as in all functions below.
    """
    X_BF, model = motion.X_BT @ np.linalg.inv(X_FT), cell.arm.name
    accepted = False
    refused: LimitReport | None = None
    for profile in profiles(motion.t_s, X_BF, cell.arm.limits, seed):
        q_rad = inverse(X_BF, profile.q7_rad(motion.t_s))[:, profile.branch]
        if not np.isfinite(q_rad).all():
            continue
        path = JointPath(motion.t_s, q_rad, motion.contact)
        report = cell.check(path)
        if report.ok and report.joint_ratio <= ALLOWED:
            accepted = True
            yield profile.ratio, path
        elif refused is None or report.worst.ratio < refused.worst.ratio:
            refused = report
    if accepted:
        return
    if refused is None:
        p = motion.X_BT[0, :3, 3]
        raise NotExecutable(
            f"{model}: the tool motion from ({p[0]:.3f}, {p[1]:.3f}, {p[2]:.3f}) m is outside the arm's reach; move it "
            "or mount the tool differently"
        )
    raise NotExecutable(
        f"{model}: no joint path keeps every limit to {ALLOWED:g}; the nearest: {refused.worst}; choose another action"
    )


def vertical(q_from: ArrayLike, rise_m: float, arm: ArmModel) -> JointPath:
    """Straight up by `rise_m` without rotation; joint 7 moves as far as needed to keep the other joints slow.

    Raises NotExecutable if the tool cannot rise that far within the position limits.
    """
    q, limits = arm.true_rad(frozen_array(q_from, (7,), "q_from")), arm.in_true_joints().limits
    X_BF = forward(q)
    branch = int(np.nan_to_num(np.abs(inverse(X_BF, q[6]) - q).max(axis=-1), nan=np.inf).argmin())

    def along(share: Array, swing: ArrayLike) -> Array:
        X = np.repeat(X_BF[None], len(share), axis=0)
        X[:, 2, 3] += share * rise_m
        return inverse(X[:, None], q[6] + np.multiply.outer(share, np.atleast_1d(swing)))[:, :, branch]

    swings = np.linspace(-_RISE_SWING_RAD, _RISE_SWING_RAD, 33)
    tried = along(np.linspace(0.0, 1.0, 21), swings)  # (21, swings, 7)
    travel = np.abs(np.diff(tried, axis=0)).max(axis=(0, -1))
    still = np.zeros_like(tried)
    inside = limits.ratios(tried, still, still)[0].max(axis=(0, -1)) <= ALLOWED
    if not (inside & np.isfinite(travel)).any():
        raise NotExecutable(f"{arm.name}: the tool cannot rise by {rise_m:g} m from where it is; lift it less")
    swing = swings[np.where(inside, travel, np.inf).argmin()]
    return arm.reported(time_curve(lambda share: along(share, swing)[:, 0], 2.2 * abs(rise_m) / VERTICAL_M_S, limits))


Ways = Callable[[Array], Iterator[JointPath]]
"""Posture after lifting the tool -> ways home, the best first. May raise NotExecutable."""


def _unless_refused(q_from: Array, ways: Ways, cell: Workcell) -> JointPath | None:
    try:
        return _homeward(q_from, ways, cell)
    except NotExecutable:
        return None


def _homeward(q_from: ArrayLike, ways: Ways, cell: Workcell) -> JointPath:
    """The path straight up, then home; it goes higher if that comes near an obstacle. It is safe in both directions."""
    refused = "nothing was tried"
    for rise_m in LIFTS_M:
        try:
            up = vertical(q_from, rise_m, cell.arm)
        except NotExecutable as error:
            refused = str(error)
            break
        for over in ways(up.q_rad[-1]):
            path = join_paths(up, over)
            both_ways = path, JointPath(path.t_s, path.q_rad[::-1])
            low_m = _lowest_m(over, cell)
            broken = next((report.worst for report in map(cell.check, both_ways) if not report.ok), None)
            if broken is None and low_m >= CLEAR_M:
                return path
            refused = str(broken) if broken else f"the tool comes down to {low_m:.3f} m, limit {CLEAR_M:g} m"
    raise NotExecutable(f"{cell.arm.name}: no way between the task and home: {refused}; choose another home posture")


def _lowest_m(path: JointPath, cell: Workcell) -> float:
    """The least height of the tool's points over the table; `CLEAR_M` for a tool without points."""
    if not len(cell.tool.points_F_m):
        return CLEAR_M
    return float(point_heights(link_poses(path.q_rad[::10]), cell.tool, cell.table).min())


def _gently(q_from: Array, q_home: Array, X_FT: Array, arm: ArmModel) -> Iterator[JointPath]:
    yield carry_path(q_from, q_home, X_FT, arm)


def _ways(q_from: Array, q_home: Array, cell: Workcell) -> Iterator[JointPath]:
    """Ways home in joint space: a straight one; else one drawn back, rotated and lowered again; else one around
    obstacles.
    """
    limits = cell.arm.limits
    yield move_path(q_from, q_home, limits, MOVE_SPEED)
    for tucked_rad in TUCKED_RAD:
        stops = [q_from, _drawn_back(q_from, tucked_rad), _drawn_back(q_home, tucked_rad), q_home]
        yield join_paths(*(move_path(a, b, limits, MOVE_SPEED) for a, b in pairwise(stops)))
    if cell.keep_out:
        with suppress(NotExecutable):
            yield free_path(q_from, q_home, cell, MOVE_SPEED)


def _drawn_back(q_rad: Array, tucked_rad: tuple[float, float]) -> Array:
    drawn = np.array(q_rad)
    drawn[[1, 3]] = tucked_rad
    return drawn
