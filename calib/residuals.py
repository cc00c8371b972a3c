"""The residuals of a solution at every point, in pixels and in millimetres on the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.checks import board_poses
from calib.projection import project
from calib.types import Forward, Setup, Solution, View
from hw.types import Array


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
    """The residuals of all views, unused ones included, in the given order, against predictions by the arm."""
    used, found = set(solution.used), []
    focal = float(np.sqrt(setup.colour.K[0, 0] * setup.colour.K[1, 1]))
    known = [view for view in views if len(view.corners) and view.corners.ids[-1] < setup.board.corners]
    poses = board_poses(solution, known, setup, forward) if known else np.zeros((0, 4, 4))
    for view, X_CM in zip(known, poses, strict=True):
        p = setup.board.p_MK_m[view.corners.ids]
        off = view.corners.px - project(setup.colour, X_CM[None], p[None])[0]
        away_m = p @ X_CM[2, :3] + X_CM[2, 3]
        off_mm = 1e3 * np.linalg.norm(off, axis=1) * away_m / focal
        found.append(Residuals(view.name, view.name in used, view.corners.ids, view.corners.px, off, off_mm))
    return tuple(found)


def table(found: Sequence[Residuals]) -> str:
    """CSV with one row per point."""
    lines = ["view,used,point,u_px,v_px,off_u_px,off_v_px,off_mm"]
    lines += [
        f"{r.name},{int(r.used)},{k},{u:.3f},{v:.3f},{du:.3f},{dv:.3f},{mm:.3f}"
        for r in found
        for k, (u, v), (du, dv), mm in zip(r.ids, r.px, r.off_px, r.off_mm, strict=True)
    ]
    return "\n".join(lines) + "\n"
