"""Solves several fixed cameras together, with one arm and one target.

The target has the same pose in the hand for all of them, and an error of the arm's posture is the same for every camera
that sees it. Shared unknowns are better known, so every camera is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.bundle import motion_of
from calib.errors import TooFewViews, UnusableViews
from calib.geometry import angle_deg, cross_matrix, distance_mm
from calib.pixels import Place, adjust, held_out_px, jackknife, looks
from calib.projection import LENS
from calib.sizing import solve_any_size
from calib.types import Forward, Mounting, Setup, View
from hw.types import Array

FOLDS = 5
MIN_SHARED = 6
_SAME_MM, _SAME_DEG = 0.5, 0.1
_NINETEEN_OF_TWENTY = 1.96


@dataclass(frozen=True, eq=False)
class Camera:
    """The inputs of one camera."""

    name: str
    views: tuple[View, ...]
    setup: Setup
    forward: Forward | None


@dataclass(frozen=True, eq=False)
class Placed:
    """One camera, solved alone and together; errors by leaving out each posture in turn."""

    name: str
    X_BC: Array  # (4, 4) by all cameras together
    used: tuple[str, ...]
    fit_px: float
    held_out_px: float  # error of every posture, predicted by a fit without its fifth of the postures
    alone_held_out_px: float  # the same for a fit of this camera alone
    sigma_mm: float  # one standard deviation of its position
    alone_sigma_mm: float
    work_95_mm: float  # at the worst corner of the work volume
    alone_work_95_mm: float
    from_alone_mm: float  # distance between the two positions


@dataclass(frozen=True, eq=False)
class Together:
    """The result for all cameras."""

    cameras: tuple[Placed, ...]
    X_FM: Array  # (4, 4) the target in the flange
    target: str  # in words, with the estimated size
    size_sigma: float  # standard deviation, as a share
    held_out_px: float


def solve_together(cameras: Sequence[Camera]) -> Together:
    """Solve each camera, then all together.

    Views of the same name show the same posture. Raises UnusableViews or a subclass.
    """
    _possible(cameras)
    _same_arm(cameras)
    alone = [solve_any_size(camera.views, camera.setup, camera.forward) for camera in cameras]
    factor = float(np.mean([setup.board.spacing_m for _, setup in alone])) / alone[0][1].board.spacing_m
    target = alone[0][1].board.scaled(factor)
    chosen = [
        [view for view in camera.views if view.name in set(solution.used)]
        for camera, (solution, _) in zip(cameras, alone, strict=True)
    ]
    flat = [(k, view) for k, views in enumerate(chosen) for view in views]
    X_BF = np.concatenate([_poses(camera, views) for camera, views in zip(cameras, chosen, strict=True)])
    of = looks(
        [view.corners for _, view in flat], X_BF, target, [c.setup.colour for c in cameras], [k for k, _ in flat]
    )
    names = sorted({view.name for _, view in flat})
    of = replace(of, posture=np.array([names.index(view.name) for _, view in flat], dtype=np.int64))
    X_BC = np.stack([solution.X_AC for solution, _ in alone])
    start = Place(X_BC, alone[0][0].X_HM[None], 1.0, np.zeros((len(cameras), LENS)))
    scale = not cameras[0].setup.size_known
    noise = max(float(np.mean([solution.fit_px for solution, _ in alone])) / np.sqrt(2.0), 0.02)
    fit = adjust(of, start, noise, scale=scale, lens=False)
    fit = adjust(of, fit.place, max(fit.px / np.sqrt(2.0), 0.02), scale=scale, lens=False)
    held = held_out_px(of, fit, FOLDS, scale=scale, lens=False)
    covariance = jackknife(fit)
    placed = []
    for k, camera in enumerate(cameras):
        rows = of.camera == k
        pictures = replace(
            of.take(rows), cameras=(camera.setup.colour,), camera=np.zeros(int(rows.sum()), dtype=np.int64)
        )
        solution, setup = alone[k]
        size = setup.board.spacing_m / target.spacing_m
        by_itself = Place(solution.X_AC[None], solution.X_HM[None], size, np.zeros((1, LENS)))
        own = adjust(pictures, by_itself, fit.noise_px, scale=scale, lens=False)
        points = camera.setup.p_AP_m
        X, X_alone = fit.place.X_AC[k], own.place.X_AC[0]
        sigma_mm, work_mm = _errors(covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6], X, points)
        alone_sigma_mm, alone_work_mm = _errors(jackknife(own)[:6, :6], X_alone, points)
        placed.append(
            Placed(
                camera.name,
                X,
                tuple(view.name for view in chosen[k]),
                _rms(fit.rms_px[rows]),
                _rms(held[rows]),
                _rms(held_out_px(pictures, own, FOLDS, scale=scale, lens=False)),
                sigma_mm,
                alone_sigma_mm,
                work_mm,
                alone_work_mm,
                distance_mm(X, X_alone),
            )
        )
    sigma = float(np.sqrt(covariance[-1, -1])) if scale else 0.0
    return Together(tuple(placed), fit.place.X_HM[0], target.scaled(fit.place.scale).name, sigma, _rms(held))


def _possible(cameras: Sequence[Camera]) -> None:
    if len(cameras) < 2:
        raise UnusableViews(
            "only one camera: name the folders of two or more; for one camera use adaptsim calibrate solve"
        )
    for camera in cameras:
        if camera.setup.mounting is not Mounting.FIXED:
            raise UnusableViews(
                f"{camera.name}: the camera is on the wrist; only cameras that stand still share a target"
            )
    shapes = {camera.setup.board.scaled(1 / camera.setup.board.spacing_m).name for camera in cameras}
    if len(shapes) > 1 or len({camera.setup.size_known for camera in cameras}) > 1:
        raise UnusableViews(
            f"the folders state different targets ({', '.join(sorted(shapes))}): all cameras must see the same one"
        )


def _same_arm(cameras: Sequence[Camera]) -> None:
    """Views with the same name must show the same posture. Raises UnusableViews, TooFewViews."""
    first: dict[str, tuple[str, Array]] = {}
    counts: dict[str, int] = {}
    for camera in cameras:
        for view, X in zip(camera.views, _poses(camera, camera.views), strict=True):
            counts[view.name] = counts.get(view.name, 0) + 1
            other, X_other = first.setdefault(view.name, (camera.name, X))
            if distance_mm(X, X_other) > _SAME_MM or angle_deg(X, X_other) > _SAME_DEG:
                raise UnusableViews(
                    f"view {view.name} of {camera.name} is {distance_mm(X, X_other):.1f} mm and"
                    f" {angle_deg(X, X_other):.2f}° from view {view.name} of {other}: views with the same"
                    " name must show the same posture of the arm"
                )
    if sum(count > 1 for count in counts.values()) < MIN_SHARED:
        raise TooFewViews(
            f"{sum(count > 1 for count in counts.values())} postures are seen by more than one camera, at least"
            f" {MIN_SHARED} are needed: give views of the same posture the same name in every folder"
        )


def _poses(camera: Camera, views: Sequence[View]) -> Array:
    moved = motion_of(views, camera.setup.mounting, camera.forward)
    return moved.X_AH(np.zeros(moved.joints))


def _errors(covariance: Array, X_AC: Array, points_m: Array) -> tuple[float, float]:
    """For a twist in the camera's axes: sigma of the position, and the 95 % level at the worst point, in mm."""
    R = X_AC[:3, :3]
    axes = np.kron(np.eye(2), R)
    C = axes @ covariance @ axes.T
    lever = np.concatenate(
        [-cross_matrix(points_m - X_AC[:3, 3]), np.broadcast_to(np.eye(3), (len(points_m), 3, 3))], 2
    )
    spread = np.sqrt(np.trace(lever @ C @ np.swapaxes(lever, 1, 2), axis1=1, axis2=2))
    return float(1e3 * np.sqrt(np.trace(C[3:, 3:]))), float(1e3 * _NINETEEN_OF_TWENTY * spread.max())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
