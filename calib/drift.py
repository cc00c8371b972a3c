"""`calibrate check`: has anything moved since the calibration?

Three views are enough: the calibration predicts where the corners must appear. Their distance is the first half of the
verdict. The limit of 0.5 px lies between an untouched rig (0.14 px, 95th percentile 0.26 px) and a camera that moved by
2 mm (1.2 px). A shift along the line of sight hardly changes the image, so the second half is a camera pose fitted to
the three views, with its uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.bundle import ArmViews, Model, Unknowns, joint_spread, linearise, motion_of, predict
from calib.condense import PoseCandidates, condense
from calib.errors import TooFewViews, determined
from calib.geometry import angle_deg, distance_mm, move, rms
from calib.types import Drift, Forward, Setup, Solution, View
from hw.types import Array

LIMIT_PX = 0.5
MIN_VIEWS = 3
SIGNIFICANT = 5.0
"""A fitted shift or rotation of more than this many standard deviations counts, whatever the pixels say."""

LEAST_MM, LEAST_DEG = 1.2, 0.12
"""Smaller shifts or rotations do not count: calibrations do not repeat better than this on a warm day."""

LEAST_JOINT_RAD = 5e-5
"""An arm does not repeat better than this (rad), whatever the calibration's residuals say."""


def unknowns_of(solution: Solution) -> tuple[Unknowns, float]:
    """The parts of a solution that a later check needs: `was` and `joint_rad` of `drift`."""
    joints = 0 if solution.joints is None else len(solution.joints.offsets_rad)
    return Unknowns(solution.X_AC[None], solution.X_HM, solution.offsets_rad(joints)), solution.noise.joint_rad


@determined()
def drift(views: Sequence[View], setup: Setup, forward: Forward | None, was: Unknowns, joint_rad: float) -> Drift:
    """Compare at least three views with the calibration `was`.

    `joint_rad` is the spread of the joints from view to view, `Solution.noise.joint_rad`; nan if unknown. Raises
    TooFewViews, UnusableViews.
    """
    if len(views) < MIN_VIEWS:
        raise TooFewViews(f"{len(views)} views show the board, but {MIN_VIEWS} are needed to detect a moved camera")
    ordered = sorted(views, key=lambda view: view.name)
    sight = condense([v.name for v in ordered], [v.corners for v in ordered], setup.board, setup.colour)
    moved = motion_of(ordered, setup.mounting, forward)
    offsets = was.offsets_rad if len(was.offsets_rad) == moved.joints else np.zeros(moved.joints)
    state = Unknowns(was.X_AC, was.X_HM, offsets)
    X_now, covariance = _camera_now(sight, state, moved, joint_rad)
    return _verdict(was.X_AC[0], X_now, covariance, rms(sight.rms_at(predict(state, moved))))


def _camera_now(sight: PoseCandidates, state: Unknowns, moved: ArmViews, joint_rad: float) -> tuple[Array, Array]:
    """Camera pose (4, 4) fitted to the views with everything else fixed, and its covariance (6, 6)."""
    both = np.stack([np.linalg.norm(linearise(state, moved, X, Model())[0], axis=1) for X in sight.X_CM])
    side, rows = np.argmin(both, axis=0), np.arange(both.shape[1])  # the nearer one of the mirror poses
    X_CM, information = sight.X_CM[side, rows], sight.information[side, rows]
    spread = max(joint_rad, LEAST_JOINT_RAD) if np.isfinite(joint_rad) else 2 * LEAST_JOINT_RAD
    G = joint_spread(state, moved)
    L = np.linalg.inv(np.linalg.inv(information) + spread**2 * G @ np.swapaxes(G, 1, 2))
    now, covariance = state, np.eye(6)
    for _ in range(6):
        e, B = linearise(now, moved, X_CM, Model())
        A = np.einsum("nip,nij,njr->pr", B[:, :, :6], L, B[:, :, :6])
        step = np.linalg.solve(A, np.einsum("nip,nij,nj->p", B[:, :, :6], L, e))
        now = Unknowns(move(now.X_AC, np.clip(step, -0.3, 0.3)), now.X_HM, now.offsets_rad)
        covariance = np.asarray(np.linalg.inv(A), dtype=np.float64)
    return now.X_AC[0], covariance


def _verdict(X_was: Array, X_now: Array, covariance: Array, rms_px: float) -> Drift:
    shift_mm, turn_deg = distance_mm(X_was, X_now), angle_deg(X_was, X_now)
    sigma_mm = float(1e3 * np.sqrt(np.trace(covariance[3:, 3:])))
    sigma_deg = float(np.rad2deg(np.sqrt(np.trace(covariance[:3, :3]))))
    by_shift = shift_mm > max(LEAST_MM, SIGNIFICANT * sigma_mm)
    by_turn = turn_deg > max(LEAST_DEG, SIGNIFICANT * sigma_deg)
    moved = rms_px > LIMIT_PX or by_shift or by_turn
    figures = (
        f"corners {rms_px:.2f} px from where they should be (limit {LIMIT_PX} px), camera {shift_mm:.1f} ±"
        f" {sigma_mm:.1f} mm and {turn_deg:.2f} ± {sigma_deg:.2f}° from its place"
    )
    message = f"moved: {figures}; calibrate again" if moved else f"not moved: {figures}"
    return Drift(moved, rms_px, LIMIT_PX, shift_mm, turn_deg, sigma_mm, sigma_deg, X_now, message)
