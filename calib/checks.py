"""Further checks of a calibration, because small residuals prove nothing.

Each returns one `Check`, or a measurement and its `Check`, from plain values: points, samples, corners. The gates
(`gates.py`) decide what forbids a calibration. Here a value beyond its limit is "suspect"; it is "bad" only if it shows
that the calibration belongs to another setup.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.bundle import Unknowns, motion_of, predict
from calib.condense import condense
from calib.errors import determined
from calib.geometry import adjoint, angle_deg, distance_mm, move
from calib.projection import project, project_with_jacobian
from calib.types import Check, Forward, Grade, Setup, Solution, View
from hw.poses import inverse
from hw.types import Array, Intrinsics
from perception.board.types import CalibrationTarget

SQUARE_LIMIT = 0.003
"""Deviation of the board from its stated size, as a share, that is reported if it also exceeds 4 standard deviations.
"""

OFFSET_LIMIT_RAD = 1e-3
TILT_SPREAD_LIMIT_DEG = 5.0
"""Views tilted by less than 8 degrees to all sides have 4 to 4.6, and closed forms are then 3 to 5 times worse."""

TABLE_LIMIT_MM, TABLE_LIMIT_DEG = 3.0, 0.3
DEPTH_LIMIT_MM = 5.0
ALIGNMENT_LIMIT_PX = 2.0
WARM_LIMIT_C = 2.0
"""This is our choice, because no maker states how intrinsics change with temperature."""


def square_size(solution: Solution) -> Check:
    """Is the board as large as stated? The arm's motion gives an independent scale; the focal length enters as well."""
    off, sigma = solution.square_scale - 1.0, solution.square_scale_sigma
    limit = max(SQUARE_LIMIT, 4.0 * sigma)
    if not solution.size_known:
        remark = f"not stated; the arm's motion makes it a {solution.target}, to ± {100 * sigma:.2f} %"
        return Check(name="square size", verdict=Grade.GOOD, message=remark)
    message = (
        f"by the arm's motion the squares are {100 * off:+.2f} % (± {100 * sigma:.2f}) off their stated size, limit "
        f"{100 * limit:.2f} %"
    )
    advice = ": measure the print and state its true square size; if it is right, the focal length is wrong"
    measured = 100 * off, 100 * limit, "%"
    return Check.graded("square size", message, measured, advice, good=abs(off) <= limit, worse=Grade.BAD)


def joint_offsets(solution: Solution) -> Check:
    """Do the views show wrong joint zeros?"""
    joints = solution.joints
    if joints is None or not np.isfinite(joints.delta_bic):
        reason = "the views have poses, not joints" if joints is None else joints.reason
        return Check.unmeasured("joint offsets", reason)
    worst = int(np.argmax(np.abs(joints.suspected_rad)))
    value = float(1e3 * joints.suspected_rad[worst])
    limit = 1e3 * OFFSET_LIMIT_RAD
    message = f"joint {worst + 1} reads {value:+.2f} mrad off its zero; {joints.reason}"
    advice = ". The solution takes them into account; planning must use the corrected joints too"
    good = not joints.adopted or abs(value) <= limit
    return Check.graded("joint offsets", message, (value, limit, "mrad"), advice, good=good, worse=Grade.SUSPECT)


def variety(solution: Solution) -> Check:
    """Do the views differ enough?"""
    value, limit = solution.tilt_spread_deg, TILT_SPREAD_LIMIT_DEG
    message = f"the board's tilts spread by {value:.1f}° (root mean square), at least {limit:.0f}° is recommended"
    advice = ": add views tilted left, right, up and down"
    measured = value, limit, "°"
    return Check.graded("variety of views", message, measured, advice, good=value >= limit, worse=Grade.SUSPECT)


def weights(solution: Solution) -> Check:
    """Which of two fits was kept, and how both predict views that they have not seen."""
    choice = solution.choice
    return Check(name="weights", verdict=Grade.GOOD, message=choice.sentence, value=choice.held_out_px, unit="px")


def mirror_poses(solution: Solution) -> Check:
    """Views in which the mirror pose of a flat board fits the picture better, so that the arm decided."""
    names = [view.name for view in solution.views if view.mirrored]
    message = "the arm and the pictures agree on every tilt of the board"
    if names:
        message = (
            f"in view {', '.join(names)} the mirrored tilt fits the picture better, but the arm's motion rules it out. "
            "For clearer pictures, hold the board nearer or tilt it more"
        )
    return Check(name="mirror poses", verdict=Grade.GOOD, message=message)


def warm_up(readings_C: Sequence[float]) -> Check:
    """Does the camera still warm up from view to view? Then it drifts during the calibration."""
    if len(readings_C) < 3:
        return Check.unmeasured("camera temperature", "the camera does not report its temperature")
    third = max(1, len(readings_C) // 3)
    value = float(np.mean(readings_C[-third:]) - np.mean(readings_C[:third]))
    message = f"{np.median(readings_C):.1f} °C, {value:+.1f} °C from the first views to the last"
    advice = f" (limit {WARM_LIMIT_C:g} °C): let it run for 40 minutes, then calibrate with --fresh"
    measured, good = (value, WARM_LIMIT_C, "°C"), abs(value) <= WARM_LIMIT_C
    return Check.graded("camera temperature", message, measured, advice, good=good, worse=Grade.SUSPECT)


def mounting_of_board(solution: Solution, X_HM_expected: Array) -> Check:
    """Is the board held as expected? Upside down or rotated does no harm, because its pose is estimated, but it is
    reported.
    """
    turn, limit_deg = angle_deg(solution.X_HM, X_HM_expected), 30.0
    message, verdict = f"{turn:.1f}° from the expected pose", Grade.GOOD
    if turn >= limit_deg:
        faces_as_expected = float(np.dot(solution.X_HM[:3, 2], X_HM_expected[:3, 2])) > 0.7
        how = ("upside down" if turn > 135.0 else "turned") if faces_as_expected else "facing elsewhere"
        message = f"the board is {how}: {turn:.0f}° from the expected pose. Its pose is estimated, so the result holds"
        verdict = Grade.SUSPECT
    return Check(name="board's mounting", verdict=verdict, message=message, value=turn, limit=limit_deg, unit="°")


def table_plane(points_A_m: Array, expected_height_m: float = 0.0, at_xy_m: tuple[float, float] = (0.7, 0.0)) -> Check:
    """Is the table top in its place and level? It is judged by its depth points (N, 3) in the base, with the new
    calibration.

    The plane is fitted with repeated trimming; objects may cover up to a third of the points.
    """
    if len(points_A_m) < 50:
        return Check.unmeasured("table plane", f"{len(points_A_m)} depth points of the table, but 50 are needed")
    keep = np.abs(points_A_m[:, 2] - np.median(points_A_m[:, 2])) < 0.03
    plane: Array = np.zeros(3)
    for _ in range(8):
        p = points_A_m[keep]
        A = np.column_stack([p[:, 0] - at_xy_m[0], p[:, 1] - at_xy_m[1], np.ones(len(p))])
        plane = np.asarray(np.linalg.lstsq(A, p[:, 2], rcond=None)[0], dtype=np.float64)
        slopes = np.column_stack([points_A_m[:, :2] - at_xy_m, np.ones(len(points_A_m))])
        off = np.abs(points_A_m[:, 2] - slopes @ plane)
        keep = off < max(2.5 * 1.4826 * float(np.median(off[keep])), 1e-4)
    height = float(1e3 * (plane[2] - expected_height_m))
    tilt = float(np.rad2deg(np.hypot(plane[0], plane[1])))
    message = f"the table top lies {height:+.1f} mm from its place and is tilted by {tilt:.2f}°"
    good = abs(height) <= TABLE_LIMIT_MM and tilt <= TABLE_LIMIT_DEG
    advice = (
        f" (limits {TABLE_LIMIT_MM:.0f} mm, {TABLE_LIMIT_DEG}°): if depth bias and touched point are good, the rig "
        "file has the wrong table; if not, recalibrate"
    )
    measured = height, TABLE_LIMIT_MM, "mm"
    return Check.graded("table plane", message, measured, advice, good=good, worse=Grade.SUSPECT)


def board_poses(solution: Solution, views: Sequence[View], setup: Setup, forward: Forward | None) -> Array:
    """(N, 4, 4) X_CM of the views in the given order, predicted by the solution from the arm only."""
    moved = motion_of(views, setup.mounting, forward)
    return predict(Unknowns(solution.X_AC[None], solution.X_HM, solution.offsets_rad(moved.joints)), moved)


def depth_residuals(X_DM: Array, board: CalibrationTarget, depth_mm: Array, camera: Intrinsics) -> Array:
    """(K,) measured minus expected depth in m, on the inner part of the board.

    `depth_mm` (H, W), 0 = no reading; `X_DM` (4, 4) the board in the depth camera.
    """
    inner = board.outline_m.mean(axis=0) + 0.8 * (board.outline_m - board.outline_m.mean(axis=0))
    uv, _ = cv2.projectPoints(inner, cv2.Rodrigues(X_DM[:3, :3])[0], X_DM[:3, 3], camera.K, camera.distortion)
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.rint(uv).astype(np.int32).reshape(-1, 2), 1)
    v, u = np.nonzero(mask & (np.asarray(depth_mm) > 0))
    if not len(u):
        return np.zeros(0)
    rays = cv2.undistortPoints(np.stack([u, v], axis=1).astype(np.float64)[:, None], camera.K, camera.distortion)
    normal, p = X_DM[:3, 2], X_DM[:3, 3]
    expected = (normal @ p) / (np.column_stack([rays.reshape(-1, 2), np.ones(len(u))]) @ normal)
    off: Array = 1e-3 * np.asarray(depth_mm, dtype=np.float64)[v, u] - expected
    return off


def depth_bias(residuals_m: Sequence[Array]) -> Check:
    """Does the depth camera measure short or long, by the `depth_residuals` of several views?"""
    medians = np.array([np.median(r) for r in residuals_m if len(r) >= 30])
    if len(medians) < 3:
        return Check.unmeasured("depth bias", f"{len(medians)} views with depth on the board, but 3 are needed")
    value = float(1e3 * np.median(medians))
    spread = float(1e3 * np.std(medians))
    message = (
        f"depth reads {value:+.1f} mm on the board (spread over views {spread:.1f} mm, limit {DEPTH_LIMIT_MM:.0f} mm)"
    )
    measured, good = (value, DEPTH_LIMIT_MM, "mm"), abs(value) <= DEPTH_LIMIT_MM
    advice = ": let the camera warm up, and look for a second light source or a shiny board; or correct it"
    return Check.graded("depth bias", message, measured, advice, good=good, worse=Grade.SUSPECT)


@determined()
def infrared_board(
    solution: Solution, views: Sequence[View], setup: Setup, forward: Forward | None
) -> tuple[Array | None, Check]:
    """The depth camera's pose X_CD (4, 4), measured from the board in its own image.

    All other unknowns stay at the solution. The value is the shift, at the board, between depth images overlaid on the
    colour image with the factory's and with the measured extrinsics.
    """
    name = "colour-depth alignment"
    usable = [v for v in views if v.infrared is not None and len(v.infrared) >= 8 and v.name in set(solution.used)]
    if setup.infrared is None or setup.X_CD is None or len(usable) < 4:
        return None, Check.unmeasured(name, f"{len(usable)} views show the board in infrared, but 4 are needed")
    sight = condense(
        [v.name for v in usable], [v.infrared for v in usable if v.infrared is not None], setup.board, setup.infrared
    )
    X_CM = board_poses(solution, usable, setup, forward)
    X_CD = setup.X_CD
    weight = np.ones(len(usable))
    for _ in range(12):
        uv, J = project_with_jacobian(setup.infrared, inverse(X_CD) @ X_CM, sight.p_M_m)
        off = uv - sight.px
        miss = np.sqrt(np.sum(np.sum(off**2, axis=-1) * sight.weight, axis=1) / sight.weight.sum(axis=1))
        weight = np.minimum(1.0, 2.0 * np.median(miss) / np.maximum(miss, 1e-9))
        # a twist of D moves the board by the opposite twist, in the board's axes
        J_D = -J @ adjoint(inverse(X_CM) @ X_CD)[:, None]
        w = sight.weight * weight[:, None]
        A = np.einsum("nkai,nk,nkaj->ij", J_D, w, J_D)
        step = -np.linalg.solve(A, np.einsum("nkai,nk,nka->i", J_D, w, off))
        X_CD = move(X_CD, step)
        if np.abs(step).max() < 1e-10:
            break
    value = _misalignment_px(setup, X_CM, X_CD)
    message = (
        f"colour and depth are {value:.1f} px apart on the board by the factory's extrinsics: the depth camera stands"
        f" {distance_mm(X_CD, setup.X_CD):.1f} mm and {angle_deg(X_CD, setup.X_CD):.2f}° from there"
        f" (limit {ALIGNMENT_LIMIT_PX:.0f} px)"
    )
    measured, good = (value, ALIGNMENT_LIMIT_PX, "px"), value <= ALIGNMENT_LIMIT_PX
    return X_CD, Check.graded(name, message, measured, ": use the measured pose", good=good, worse=Grade.SUSPECT)


def _misalignment_px(setup: Setup, X_CM: Array, X_CD: Array) -> float:
    assert setup.X_CD is not None
    p = np.broadcast_to(setup.board.p_MK_m, (len(X_CM), setup.board.corners, 3))
    expected_px, _ = project_with_jacobian(setup.colour, X_CM, p)
    laid, _ = project_with_jacobian(setup.colour, setup.X_CD @ inverse(X_CD) @ X_CM, p)
    return float(np.mean(np.linalg.norm(laid - expected_px, axis=-1)))


@dataclass(frozen=True, eq=False)
class Residuals:
    """The residuals of one view."""

    name: str
    used: bool
    ids: NDArray[np.int64]  # (K,) of the points
    px: Array  # (K, 2) observed
    off_px: Array  # (K, 2) observed minus predicted
    off_mm: Array  # (K,) the same as a distance on a plane through the target, across the line of sight

    @property
    def rms_px(self) -> float:
        """Root mean square distance."""
        return float(np.sqrt(np.mean(np.sum(self.off_px**2, axis=1))))

    @property
    def rms_mm(self) -> float:
        """The same on the target."""
        return float(np.sqrt(np.mean(self.off_mm**2)))


def residuals(
    views: Sequence[View], setup: Setup, solution: Solution, forward: Forward | None
) -> tuple[Residuals, ...]:
    """The residuals of all views against the arm's predictions, in the given order, unused views included."""
    used, rows = set(solution.used), []
    focal = float(np.sqrt(setup.colour.K[0, 0] * setup.colour.K[1, 1]))
    usable = [view for view in views if len(view.corners) and view.corners.ids[-1] < setup.board.corners]
    poses = board_poses(solution, usable, setup, forward) if usable else np.zeros((0, 4, 4))
    for view, X_CM in zip(usable, poses, strict=True):
        p = setup.board.p_MK_m[view.corners.ids]
        off = view.corners.px - project(setup.colour, X_CM[None], p[None])[0]
        away_m = p @ X_CM[2, :3] + X_CM[2, 3]
        off_mm = 1e3 * np.linalg.norm(off, axis=1) * away_m / focal
        rows.append(Residuals(view.name, view.name in used, view.corners.ids, view.corners.px, off, off_mm))
    return tuple(rows)


def residuals_table(rows: Sequence[Residuals]) -> str:
    """CSV with one row per point."""
    lines = ["view,used,point,u_px,v_px,off_u_px,off_v_px,off_mm"]
    lines += [
        f"{r.name},{int(r.used)},{k},{u:.3f},{v:.3f},{du:.3f},{dv:.3f},{mm:.3f}"
        for r in rows
        for k, (u, v), (du, dv), mm in zip(r.ids, r.px, r.off_px, r.off_mm, strict=True)
    ]
    return "\n".join(lines) + "\n"
