"""Solves several fixed cameras together, with one arm and one target.

The target has the same pose in the hand for all of them, and an error of the arm's posture is the same for every camera
that sees it. Shared unknowns are better known, so every camera is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import gates
from calib.bundle import Unknowns, motion_of, predict
from calib.condense import condense
from calib.errors import TooFewViews, UnusableViews, determined
from calib.estimate import BestFit, Data, estimate
from calib.foreign.pairing import Fault, faults
from calib.foreign.sizing import solve_any_size
from calib.geometry import angle_deg, distance_mm, rms
from calib.types import Check, Choice, Forward, Mounting, Setup, Solution, View, ViewFit, reasons
from calib.uncertainty import jackknife, uncertainty
from hw.types import Array

MIN_SHARED = 6
_SAME_MM, _SAME_DEG = 0.5, 0.1


@dataclass(frozen=True, eq=False)
class CameraViews:
    """The inputs of one camera."""

    name: str
    views: tuple[View, ...]
    setup: Setup
    forward: Forward | None


@dataclass(frozen=True, eq=False)
class CameraSolution:
    """One camera, solved alone and together."""

    name: str
    X_BC: Array  # (4, 4) by all cameras together
    used: tuple[str, ...]
    rejected: tuple[ViewFit, ...]
    faults: tuple[Fault, ...]  # of the rejected views
    fit_px: float
    held_out_px: float  # error of every posture, predicted by a fit without its fifth of the postures
    alone_held_out_px: float  # the same for a fit of this camera alone
    sigma_mm: float  # one standard deviation of its position
    alone_sigma_mm: float
    worst_95_mm: float  # at the worst corner of the work volume
    alone_worst_95_mm: float
    from_alone_mm: float  # distance between the two positions
    gates: tuple[Check, ...]


@dataclass(frozen=True, eq=False)
class JointSolution:
    """The result for all cameras."""

    cameras: tuple[CameraSolution, ...]
    X_FM: Array  # (4, 4) the target in the flange
    target: str  # in words, with the estimated size
    size_sigma: float  # standard deviation, as a share
    held_out_px: float
    choice: Choice

    @property
    def accepted(self) -> bool:
        """Whether no gate of any camera forbids it."""
        return not any(reasons(camera.gates) for camera in self.cameras)


@determined()
def solve_together(cameras: Sequence[CameraViews]) -> JointSolution:
    """Solve each camera, then all together, by the same estimator.

    Views of the same name show the same posture. Raises UnusableViews or a subclass.
    """
    _possible(cameras)
    _same_arm(cameras)
    alone = [solve_any_size(camera.views, camera.setup, camera.forward) for camera in cameras]
    factor = float(np.mean([setup.board.spacing_m for _, setup in alone])) / alone[0][1].board.spacing_m
    target = alone[0][1].board.scaled(factor)
    data, start = _data([replace(c, setup=replace(c.setup, board=target)) for c in cameras], [s for s, _ in alone])
    scale = not cameras[0].setup.size_known
    joint = estimate(data, start, scale=scale)
    fit_px = data.rms_at(predict(joint.fit.state, data.moved))
    placed = tuple(
        _placed(k, camera, solution, setup, data, joint, fit_px)
        for k, (camera, (solution, setup)) in enumerate(zip(cameras, alone, strict=True))
    )
    sigma = float(np.sqrt(jackknife(joint.fit)[-1, -1])) if scale else 0.0
    size = target.scaled(joint.fit.state.scale).name
    return JointSolution(placed, joint.fit.state.X_HM, size, sigma, joint.folds.rms_px, joint.choice)


def _data(cameras: Sequence[CameraViews], alone: Sequence[Solution]) -> tuple[Data, Unknowns]:
    """The views that each camera uses alone, and a start from those solutions."""
    chosen = [[v for v in c.views if v.name in set(s.used)] for c, s in zip(cameras, alone, strict=True)]
    flat = [view for views in chosen for view in views]
    candidates = tuple(
        condense([v.name for v in views], [v.corners for v in views], c.setup.board, c.setup.colour)
        for c, views in zip(cameras, chosen, strict=True)
    )
    names = np.unique([view.name for view in flat], return_inverse=True)[1].astype(np.int64)
    index = np.repeat(np.arange(len(cameras)), [len(views) for views in chosen])
    forward = next((camera.forward for camera in cameras if camera.forward is not None), None)
    moved = replace(motion_of(flat, Mounting.FIXED, forward), camera=index, posture=names)
    start = Unknowns(np.stack([s.X_AC for s in alone]), alone[0].X_HM, np.zeros(moved.joints))
    data = Data(candidates, moved, candidates[0].candidate(0), np.arange(len(flat)), vague=True)
    return replace(data, boards=data.about(predict(start, moved))), start


def _placed(
    k: int, camera: CameraViews, alone: Solution, setup: Setup, data: Data, joint: BestFit, fit_px: Array
) -> CameraSolution:
    rows = data.moved.camera == k
    held = joint.folds.px[rows[joint.folds.rows]]
    X, own_uncertainty = joint.fit.state.X_AC[k], uncertainty(joint.fit, data.moved, setup, joint.joints, k)
    figures = {"fit_px": rms(fit_px[rows]), "held_out_px": rms(held), "worst_95_mm": own_uncertainty.worst_95_mm}
    return CameraSolution(
        name=camera.name,
        X_BC=X,
        used=alone.used,
        rejected=alone.rejected,
        faults=faults(camera.views, setup, camera.forward, alone),
        **figures,
        alone_held_out_px=alone.choice.held_out_px,
        sigma_mm=own_uncertainty.sigma_mm,
        alone_sigma_mm=alone.uncertainty.sigma_mm,
        alone_worst_95_mm=alone.uncertainty.worst_95_mm,
        from_alone_mm=distance_mm(X, alone.X_AC),
        gates=gates.of_camera(alone, setup, **figures),
    )


def _possible(cameras: Sequence[CameraViews]) -> None:
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


def _same_arm(cameras: Sequence[CameraViews]) -> None:
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


def _poses(camera: CameraViews, views: Sequence[View]) -> Array:
    moved = motion_of(views, camera.setup.mounting, camera.forward)
    return moved.X_AH(np.zeros(moved.joints))
