"""How good a calibration is, beside OpenCV's closed forms on the same views.

    python benchmarks/calibration.py                 200 seeds of simulated corners, no rendering

There are 20 views of a 280 x 200 mm board on a Panda's flange, 0.7 to 1.3 m before a Kinect. In the first case the
corners have 0.1 px of noise along each axis. The second adds 0.1 mrad of encoder noise and joint offsets of 0.5 mrad
(both normal). In the third, 3 of the 20 views are spoilt too: their flange is 10 to 60 mm from where the joints say.
"Work volume" is the worst of its eight corners. "Arm's own" leaves out the rotation of the base that no view can show
(the offset of joint 1). The rest is the error that matters if the same arm uses what the camera measures. Seeds start
at 0; the factors of the stated error come from seeds 10000 and on.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
from kept import Kept
from simulated_views import (
    BOUNDS,
    Quality,
    Truth,
    example_setup,
    example_truth,
    random_poses,
    seen,
    spoilt,
    work_error_mm,
)

from calib.bundle import motion_of
from calib.closed_form import opencv_methods
from calib.condense import condense
from calib.drift import drift, unknowns_of
from calib.errors import CalibrationError
from calib.geometry import angle_deg, distance_mm, move
from calib.solve import solve
from calib.types import Setup, Solution, View
from hw.kinematics import forward
from hw.types import Array

VIEWS = 20
CHECK_VIEWS = 3
CORNER_PX = 0.1
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    name: str
    joint_rad: float
    offset_rad: float
    spoilt: int
    bar_mm: float
    bar_deg: float


CASES = (
    Case("noise only", 0.0, 0.0, 0, 0.3, 0.02),
    Case("+ encoder 0.1, offsets 0.5 mrad", 1e-4, 5e-4, 0, 1.5, 0.06),
    Case("+ 15 % outlier poses", 1e-4, 5e-4, 3, 1.5, 0.06),
)


def one(seed: int, case: Case) -> Row:
    """One calibration; `others` has mm, degrees and mm in the work volume by method, the checks (moved?, px)."""
    rng = np.random.default_rng(seed)
    setup = example_setup()
    eye = example_truth(rng)
    truth = Truth(eye.X_AC, eye.X_HM, case.offset_rad * rng.standard_normal(7))
    quality = Quality(CORNER_PX, case.joint_rad)
    q = random_poses(setup, truth, forward, BOUNDS, VIEWS + CHECK_VIEWS, rng)
    clean = seen(setup, truth, forward, q[:VIEWS], quality, rng)
    bad = rng.permutation(VIEWS)[: case.spoilt].tolist()
    views = spoilt(clean, bad, forward, rng)
    start = time.process_time()
    solution = solve(views, setup, forward)
    solve_s = time.process_time() - start
    others, opencv_s = _others(views, setup, truth)
    wrong, dropped = {views[i].name for i in bad}, {view.name for view in solution.rejected}
    u = solution.uncertainty
    return dict(
        mm=distance_mm(solution.X_AC, truth.X_AC),
        deg=angle_deg(solution.X_AC, truth.X_AC),
        work_mm=_worst(solution.X_AC, truth.X_AC, setup),
        arm_work_mm=_worst(solution.X_AC, _turned(-truth.offsets_rad[0]) @ truth.X_AC, setup),
        position_95_mm=u.position_95_mm,
        rotation_95_deg=u.rotation_95_deg,
        worst_95_mm=u.worst_95_mm,
        arm_worst_95_mm=u.arm_worst_95_mm,
        adopted=solution.joints is not None and solution.joints.adopted,
        missed=len(wrong - dropped),
        lost=len(dropped - wrong),
        good=VIEWS - case.spoilt,
        held_out_px=solution.held_out_px,
        solve_s=solve_s,
        opencv_s=opencv_s,
        others=others,  # mm, degrees, work mm by method
        **_drift(setup, truth, quality, solution, q[VIEWS:], rng),
    )


def _others(views: Sequence[View], setup: Setup, truth: Truth) -> tuple[dict[str, tuple[float, float, float]], float]:
    """OpenCV's methods on all views, and the processor time of all five together."""
    sight = condense([v.name for v in views], [v.corners for v in views], setup.board, setup.colour)
    X_AH = motion_of(views, setup.mounting, forward).X_AH(np.zeros(7))
    start = time.process_time()
    by_method = opencv_methods(X_AH, sight.X_CM[0])
    seconds = time.process_time() - start
    return {
        name: (distance_mm(X, truth.X_AC), angle_deg(X, truth.X_AC), _worst(X, truth.X_AC, setup))
        for name, X in by_method.items()
    }, seconds


def _drift(
    setup: Setup, truth: Truth, quality: Quality, solution: Solution, q: Array, rng: np.random.Generator
) -> dict[str, tuple[bool, float]]:
    """`calibrate check` with three new poses: untouched, moved by 2 mm, turned by 0.2 degrees, any direction."""
    was = unknowns_of(solution)
    out = {}
    for name, size in (
        ("untouched", np.zeros(2)),
        ("shifted", np.array([0.0, 2e-3])),
        ("turned", np.deg2rad([0.2, 0.0])),
    ):
        axes = rng.standard_normal((2, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        now = Truth(move(truth.X_AC, (size[:, None] * axes).ravel()), truth.X_HM, truth.offsets_rad)
        check = drift(seen(setup, now, forward, q, quality, rng), setup, forward, *was)
        out[name] = (check.moved, check.rms_px)
    return out


def _worst(X: Array, X_true: Array, setup: Setup) -> float:
    return float(work_error_mm(X, X_true, setup.p_AP_m).max())


def _turned(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    X = np.eye(4)
    X[:2, :2] = [[c, -s], [s, c]]
    return X


def summary(case: Case, rows: Sequence[Row]) -> dict[str, Any]:
    """Figures of one case; pairs are median and 95th percentile."""

    def column(name: str) -> Array:
        return np.array([row[name] for row in rows])

    def pair(values: Array | Sequence[float]) -> list[float]:
        return [round(float(np.median(values)), 4), round(float(np.percentile(values, 95)), 4)]

    def share(values: Any) -> float:
        return round(float(np.mean(values)), 3)

    def covered(stated: str, true: str) -> dict[str, float]:
        s, t = column(stated), column(true)
        return {
            "coverage": share(t <= s),
            "stated_median": round(float(np.median(s)), 4),
            "stated_over_true_median": round(float(np.median(s) / np.median(t)), 2),
            "least_possible": round(float(np.percentile(t, 95) / np.median(t)), 2),
            "stated_p95_over_its_median": round(float(np.percentile(s, 95) / np.median(s)), 2),
        }

    measures = ("mm", "deg", "work_mm")
    checked = {name: list(zip(*column(name).tolist(), strict=True)) for name in ("untouched", "shifted", "turned")}
    return {
        "case": case.name,
        "seeds": len(rows),
        "ours": {name: pair(column(name)) for name in measures},
        "ours_arms_own": {"work_mm": pair(column("arm_work_mm"))},
        "opencv": {
            method: {
                name: pair([row["others"][method][k] for row in rows if method in row["others"]])
                for k, name in enumerate(measures)
            }
            for method in rows[0]["others"]
        },
        "bar_p95": {"mm": case.bar_mm, "deg": case.bar_deg},
        "stated": {
            "position": covered("position_95_mm", "mm"),
            "rotation": covered("rotation_95_deg", "deg"),
            "work volume": covered("worst_95_mm", "work_mm"),
            "work volume, arm's own": covered("arm_worst_95_mm", "arm_work_mm"),
        },
        "held_out_px": pair(column("held_out_px")),
        "offsets_adopted": share(column("adopted")),
        "outliers_missed": sum(row["missed"] for row in rows),
        "outliers": case.spoilt * len(rows),
        "good_lost_share": round(sum(row["lost"] for row in rows) / sum(row["good"] for row in rows), 4),
        "solve_cpu_s": pair(column("solve_s")),
        "solve_over_opencv_five": round(float(np.median(column("solve_s")) / np.median(column("opencv_s"))), 1),
        "check": {
            "false_alarms": share(checked["untouched"][0]),
            "caught_2mm": share(checked["shifted"][0]),
            "caught_0.2deg": share(checked["turned"][0]),
            "px_untouched": pair(checked["untouched"][1]),
            "px_2mm": pair(checked["shifted"][1]),
            "px_0.2deg": pair(checked["turned"][1]),
        },
    }


def show(report: dict[str, Any]) -> None:
    """The table of one case."""
    print(f"\n{report['case']}, {report['seeds']} seeds; median / p95, bar on p95: {report['bar_p95']}")
    print(f"{'method':<12}{'mm':>18}{'degrees':>18}{'work volume mm':>20}")
    for name, row in {**report["opencv"], "ours": report["ours"]}.items():
        columns = (
            f"{row[k][0]:>{w - 9}.3f} / {row[k][1]:<6.3f}" for k, w in (("mm", 18), ("deg", 18), ("work_mm", 20))
        )
        print(f"{name:<12}{''.join(columns)}")
    for key in sorted(report.keys() - {"case", "seeds", "ours", "opencv", "bar_p95", "stated"}, key=list(report).index):
        print(f"  {key}: {report[key]}")
    for name, row in report["stated"].items():
        print(f"  stated error, {name}: {row}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="JSON lines, written as it goes and read on resuming")
    options = parser.parse_args()
    store = Kept(options.keep)
    for case in CASES:
        rows = []
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            try:
                rows.append(store.row(case.name, seed, partial(one, seed, case)))
            except CalibrationError as error:
                print(f"{case.name}, seed {seed}: {error}", file=sys.stderr)
        show(summary(case, rows))
        sys.stdout.flush()


if __name__ == "__main__":
    main()
