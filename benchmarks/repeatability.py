"""How far apart two halves of the same views place a camera, compared with a plain bundle adjustment over pixels.

    python benchmarks/repeatability.py [--seeds 3]

Real postures of a Panda before three fixed cameras (tests/data/panda-realsense), in even and odd views. `marker` has
the real corners of a 40 mm marker. `board` has a chessboard of 8 x 6 corners in its place, projected by the solved
calibration, with white noise of 0.09 px: its true camera is known. To both, errors common to a view are added: a smooth
warp of the picture (random waves, some four times as long as the target), of 0.2 to 1 px root mean square.
`lens` multiplies the focal length by 1.01 and adds 0.01 to k1 of the stated intrinsics.

The plain fit minimises a soft-L1 loss (1 px) over all corners of all views; it rejects nothing. "apart" is the distance
of the two camera positions, "other half" the error with which one half predicts the other; root mean squares over
cameras and seeds. "covered" counts halves (board) whose true error at the worst corner of the target's places is below
the stated 95 %; of the marker, pairs of halves whose distance there is below the root of the sum of squares.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
import real_views
from simulated_views import work_error_mm

from calib.closed_form import robust_start
from calib.condense import condense
from calib.errors import CalibrationError
from calib.foreign.intrinsics_check import settle
from calib.foreign.sizing import solve_any_size
from calib.geometry import distance_mm, move
from calib.projection import project
from calib.types import Mounting, Setup, View
from hw.poses import inverse
from hw.types import Array
from perception.board.targets import Chessboard
from perception.board.types import CalibrationTarget, Corners

COMMON_PX = (0.0, 0.2, 0.5, 1.0)
WHITE_PX = 0.09
LENS = 0.01
SOFT_PX = 1.0
WAVES, WAVELENGTH = 8, 4.0


Row = dict[str, Any]
"""One camera and seed of one case; `other_px` is nan where a half could not be solved."""


def setup_of(target: str, number: int) -> Setup:
    board: CalibrationTarget = real_views.MARKER.scaled(0.8) if target == "marker" else Chessboard(8, 6, 0.025)
    return Setup(Mounting.FIXED, board, real_views.camera(number), work_points_m=None)


def views_of(target: str, number: int, setup: Setup, common_px: float, seed: int) -> tuple[list[View], Array]:
    """Views, and the camera's pose that the board's corners are projected with."""
    solution, _ = solve_any_size(real_views.views(number), real_views.setup(number), None)
    rng = np.random.default_rng([seed, number, round(10 * common_px)])
    views = []
    for view in real_views.views(number):
        ids, px = view.corners.ids, view.corners.px
        if target == "board":
            ids = np.arange(setup.board.corners)
            X = inverse(solution.X_AC) @ np.asarray(view.X_BF) @ solution.X_HM
            px = project(setup.colour, X[None], setup.board.p_MK_m[None])[0] + WHITE_PX * rng.standard_normal(
                (len(ids), 2)
            )
        views.append(replace(view, corners=Corners(ids, px + common_px * warp(setup.board.p_MK_m[ids], rng))))
    return views, solution.X_AC


def warp(p_m: Array, rng: np.random.Generator) -> Array:
    """(K, 2) a smooth field over points (K, 3) of a plane, 1 px root mean square over all draws: long random waves."""
    across = (p_m[:, :2] - p_m[:, :2].mean(axis=0)) / float(np.ptp(p_m[:, :2], axis=0).max())
    waves = 2 * np.pi * rng.standard_normal((2, WAVES, 2)) / WAVELENGTH
    phases = rng.uniform(0, 2 * np.pi, (2, WAVES, 1))
    return np.asarray(np.cos(waves @ across.T + phases).sum(axis=1).T / np.sqrt(WAVES))


def plain(views: Sequence[View], setup: Setup) -> tuple[Array, Array]:
    """X_AC and X_HM by a soft-L1 bundle adjustment over pixels."""
    X_AH = np.stack([np.asarray(view.X_BF) for view in views])
    sight = condense([v.name for v in views], [v.corners for v in views], setup.board, setup.colour)
    X_AC, X_HM = robust_start(X_AH, sight.X_CM[0])
    is_visible = sight.weight > 0

    def residual(x: Array) -> Array:
        X = inverse(move(X_AC, x[:6])) @ X_AH @ move(X_HM, x[6:])
        return (project(setup.colour, X, sight.p_M_m) - sight.px)[is_visible].ravel()

    fit = least_squares(residual, np.zeros(12), x_scale=1e-3, loss="soft_l1", f_scale=SOFT_PX, max_nfev=200)
    return move(X_AC, fit.x[:6]), move(X_HM, fit.x[6:])


def predicted_px(X_AC: Array, X_HM: Array, views: Sequence[View], setup: Setup) -> float:
    off = []
    for view in views:
        X = inverse(X_AC) @ np.asarray(view.X_BF) @ X_HM
        off.append(project(setup.colour, X[None], setup.board.p_MK_m[view.corners.ids][None])[0] - view.corners.px)
    return float(np.sqrt(np.mean([np.mean(np.sum(o**2, axis=1)) for o in off])))


def case(target: str, common_px: float, lens: bool, number: int, seed: int) -> Row:
    setup = setup_of(target, number)
    views, X_true = views_of(target, number, setup, common_px, seed)
    if lens:
        K, distortion = setup.colour.K.copy(), setup.colour.distortion.copy()
        K[[0, 1], [0, 1]] *= 1 + LENS
        distortion[0] += LENS
        setup = replace(setup, colour=replace(setup.colour, K=K, distortion=distortion))
    halves = (views[::2], views[1::2])
    others = halves[::-1]
    by_pixels = [plain(half, setup) for half in halves]
    nan = float("nan")
    plain_px = [predicted_px(*solution, other, setup) for solution, other in zip(by_pixels, others, strict=True)]
    row: Row = {"target": target, "common_px": common_px, "lens": lens}
    row |= dict.fromkeys(("apart_mm", "other_px", "error_mm", "error_plain_mm"), nan)
    row |= {"apart_plain_mm": distance_mm(by_pixels[0][0], by_pixels[1][0]), "other_plain_px": rms(plain_px)}
    if target == "board":  # whose true camera is known; root mean squares of the halves
        row["error_plain_mm"] = rms([distance_mm(X, X_true) for X, _ in by_pixels])
    try:
        solved = [settle(half, setup, None)[0] for half in halves]
    except CalibrationError:
        return row | {"covered": 0, "judged": 2}
    ours_px = [predicted_px(s.X_AC, s.X_HM, o, setup) for s, o in zip(solved, others, strict=True)]
    stated = [s.uncertainty.worst_95_mm for s in solved]
    points = setup.p_AP_m
    if target == "board":
        good = [work_error_mm(s.X_AC, X_true, points).max() <= w for s, w in zip(solved, stated, strict=True)]
        row["error_mm"] = rms([distance_mm(s.X_AC, X_true) for s in solved])
    else:
        good = [work_error_mm(solved[0].X_AC, solved[1].X_AC, points).max() <= float(np.hypot(stated[0], stated[1]))]
    return row | {
        "apart_mm": distance_mm(solved[0].X_AC, solved[1].X_AC),
        "other_px": rms(ours_px),
        "covered": sum(good),
        "judged": len(good),
    }


def rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    print(
        "| target | common, px | lens | apart, mm | plain | other half, px | plain | true, mm | plain | covered |"
        " failed |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for target in ("marker", "board"):
        for lens in (False, True):
            for common_px in COMMON_PX:
                alike = 1 if target == "marker" and common_px == 0 else given.seeds
                rows = [case(target, common_px, lens, k, seed) for k in range(3) for seed in range(alike)]
                print(line(rows), flush=True)


def line(rows: Sequence[Row]) -> str:
    good = [row for row in rows if np.isfinite(row["other_px"])]
    names = ("apart_mm", "apart_plain_mm", "other_px", "other_plain_px", "error_mm", "error_plain_mm")
    cells = [f"{rms([row[name] for row in good]):.2f}" if good else "-" for name in names]
    covered = f"{sum(row['covered'] for row in good)} of {sum(row['judged'] for row in good)}"
    first = rows[0]
    lens = "1 % off" if first["lens"] else "as stated"
    head = f"| {first['target']} | {first['common_px']:g} | {lens}"
    return f"{head} | {' | '.join(cells)} | {covered} | {len(rows) - len(good)} |"


if __name__ == "__main__":
    main()
